"""The functions of a planner that others call, in C: what it is given is checked, what it found is made a motion."""

from __future__ import annotations

from string import Template

# planning._opposite_signs
COMPONENTS = Template(r"""
/* Whether start and goal lie on different sides of a surface that no path of the machine crosses for good. */
static int apart(const double *start, const double *goal)
{
    double here[APART], there[APART], values[LARGEST];
    separating(start, here);
    separating(goal, there);
    for (int which = 0; which < SEPARATING; ++which) {
        const int size = SEPARATING_SIZE[which], entries = size * size;
        double *ends[2] = {here + SEPARATING_AT[which], there + SEPARATING_AT[which]}, nearest = HUGE_VAL;
        if (!(determinant(size, ends[0]) * determinant(size, ends[1]) < 0.0))
            continue;
        for (int end = 0; end < 2; ++end) {
            double least, largest;
            for (int j = 0; j < entries; ++j)
                ends[end][j] /= COLUMN_SCALES[SEPARATING_AT[which] + j];
            decompose(size, size, ends[end], 0, values);
            extremes(size, values, &least, &largest);
            nearest = fmin(nearest, least);
        }
        if (nearest > ON_THE_SURFACE)
            return 1;
    }
    return 0;
}
""")

# so3.on_group
GROUP = r"""
/* Makes nine numbers that are nearly a rotation the nearest one, its polar factor, by Newton's method [Higham 1986];
 * whether they are near one. */
static int make_rotation(double *m)
{
    double given[9], worst = 0.0;
    for (int i = 0; i < 9; ++i)
        given[i] = m[i];
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) {
            double sum = i == j ? -1.0 : 0.0;
            for (int k = 0; k < 3; ++k)
                sum += m[3 * k + i] * m[3 * k + j];
            worst = fmax(worst, fabs(sum));
        }
    if (!(worst <= 10.0 * GROUP_TOLERANCE))
        return 0;
    for (int turn = 0; turn < 4; ++turn) {
        double cofactors[9], det;
        for (int i = 0; i < 9; ++i) {
            const int r = i / 3, c = i % 3, r1 = (r + 1) % 3, r2 = (r + 2) % 3, c1 = (c + 1) % 3, c2 = (c + 2) % 3;
            cofactors[i] = m[3 * r1 + c1] * m[3 * r2 + c2] - m[3 * r1 + c2] * m[3 * r2 + c1];
        }
        det = m[0] * cofactors[0] + m[1] * cofactors[1] + m[2] * cofactors[2];
        if (!(det > 0.0))
            return 0;
        for (int i = 0; i < 9 && worst > ROUNDED; ++i)
            m[i] = 0.5 * (m[i] + cofactors[i] / det);
    }
    for (int i = 0; i < 9; ++i)
        if (!(fabs(m[i] - given[i]) <= GROUP_TOLERANCE))
            return 0;
    return 1;
}
"""

ROTATIONS = Template(r"""
void ${name}_rotation_of_quaternion(double w, double x, double y, double z, double rotation[9])
{
    const double rows[9] = {
        1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y),
        2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x),
        2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)};
    for (int i = 0; i < 9; ++i)
        rotation[i] = rows[i];
}

void ${name}_rotation_of_rpy(double roll, double pitch, double yaw, double rotation[9])
{
    const double cr = cos(roll), sr = sin(roll), cp = cos(pitch), sp = sin(pitch), cy = cos(yaw), sy = sin(yaw);
    const double rows[9] = {
        cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr,
        sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr,
        -sp, cp * sr, cp * cr};
    for (int i = 0; i < 9; ++i)
        rotation[i] = rows[i];
}
""")

JOINTS = Template(r"""
static void set_joints(struct ${name}_plan *plan, struct ${name}_work *work)
{
    sample_controls(&OWN, plan->coefficients, work->controls);
    for (int s = 0; s < STEPS; ++s) {
        const long long *nodes = NODES + K * s;
        if (s && nodes[0] == nodes[-1])
            for (int j = 0; j < ${upper}_JOINTS; ++j)
                plan->speeds[s][0][j] = plan->speeds[s - 1][1][j];
        else
            joints(plan->states[s], work->controls + M * nodes[0], plan->joints[s], plan->speeds[s][0]);
        joints(plan->states[s + 1], work->controls + M * nodes[K - 1], plan->joints[s + 1], plan->speeds[s][1]);
    }
}

void ${name}_at(const struct ${name}_plan *plan, double t, double joint[${upper}_JOINTS], double speed[${upper}_JOINTS])
{
    const int outside = !(t >= 0.0 && t <= ${upper}_HORIZON);
    int low = 0, high = STEPS;
    t = fmin(fmax(t, 0.0), ${upper}_HORIZON);
    while (high - low > 1) {
        const int middle = low + (high - low) / 2;
        if (${name}_times[middle] <= t)
            low = middle;
        else
            high = middle;
    }
    const double h = ${name}_times[high] - ${name}_times[low], z = (t - ${name}_times[low]) / h, w = 1.0 - z;
    for (int i = 0; i < ${upper}_JOINTS; ++i) {
        const double p0 = plan->joints[low][i], p1 = plan->joints[high][i];
        const double v0 = plan->speeds[low][0][i], v1 = plan->speeds[low][1][i];
        if (joint)
            joint[i] = w * w * (1.0 + 2.0 * z) * p0 + z * z * (3.0 - 2.0 * z) * p1 + h * z * w * (w * v0 - z * v1);
        if (speed)
            speed[i] = outside ? 0.0
                               : 6.0 * z * w * (p1 - p0) / h + w * (1.0 - 3.0 * z) * v0 + z * (3.0 * z - 2.0) * v1;
    }
}
""")

ANSWER = Template(r"""
/* Nothing moves. */
static void stand_still(const double *start, struct ${name}_plan *plan)
{
    plan->updates = plan->evaluations = 0;
    plan->error = NAN;
    for (int j = 0; j < COLUMNS; ++j)
        plan->coefficients[j] = 0.0;
    for (int s = 0; s <= STEPS; ++s)
        for (int j = 0; j < N; ++j)
            plan->states[s][j] = start[j];
}

static int answer(const double *start, const double *goal, const double *initial, struct ${name}_plan *plan,
                  struct ${name}_work *work)
{
    double from[N], to[N];
    struct task task;
    int status;
    for (int j = 0; j < N; ++j) {
        from[j] = start[j];
        to[j] = start[j];
    }
    for (int j = 0; j < FIXED; ++j)
        to[FIXED_AT[j]] = goal[FIXED_AT[j]];
    stand_still(from, plan);
    if (!all_finite(N, from) || !all_finite(N, to) || !all_finite(COLUMNS, initial))
        return ${upper}_NOT_FINITE;$group
    stand_still(from, plan);$apart
    set_task(from, to, &task);
    for (int i = 0; i < BLOCKS * (N + M) * L; ++i)
        work->samples[i] = 0.0; /* of the last block some are never set */
    status = search(&task, initial, plan, work);
    return status == ${upper}_CONVERGED && !confirmed(&task, plan->coefficients, work) ? ${upper}_NOT_VERIFIED : status;
}

enum ${name}_status ${name}_solve(const double start[${upper}_STATE], const double goal[${upper}_STATE],
                                  const double *initial, struct ${name}_plan *plan, struct ${name}_work *work)
{
    plan->status = (enum ${name}_status)answer(start, goal, initial ? initial : ${name}_initial, plan, work);$set_joints
    return plan->status;
}

const char *${name}_status_name(enum ${name}_status status)
{
    switch (status) {
$names
    }
    return "unknown";
}

#ifdef ${upper}_EXAMPLE
/* The file's own problem: the status, and a row of coefficients for each input. */
int main(void)
{
    static struct ${name}_work work;
    static struct ${name}_plan plan;
    ${name}_solve(${name}_start, ${name}_goal, 0, &plan, &work);
    printf("%s: E = %.3g after %d updates, %d evaluations\n", ${name}_status_name(plan.status), plan.error,
           plan.updates, plan.evaluations);
    for (int i = 0; i < ${upper}_COEFFICIENTS; ++i)
        printf("%.17g%c", plan.coefficients[i], (i + 1) % ${upper}_FUNCTIONS ? ' ' : '\n');
    return plan.status != ${upper}_CONVERGED;
}
#endif
""")

GROUP_CHECK = Template("""
    for (int block = 0; block < ROTATIONS; ++block)
        if (!make_rotation(from + ROTATION_AT[block]) || !make_rotation(to + ROTATION_AT[block]))
            return ${upper}_BAD_INPUT;""")
APART_CHECK = Template("""
    if (apart(from, to))
        return ${upper}_OTHER_COMPONENT;""")
