"""Where a control leads, in C: its path, the error at the end, the surfaces that it crosses, and its derivative."""

from __future__ import annotations

from string import Template

PATH = Template(r"""
struct grid {
    long long steps, samples;
    const double *h;
    const long long *nodes;
    const double *phi; /* samples x WIDTH, of the functions from `first` on */
    const int *first;  /* null: from the first of all on */
};
static const struct grid OWN = {STEPS, SAMPLES, H, NODES, PHI, $first};
static const struct grid FINE = {FINE_STEPS, FINE_SAMPLES, FINE_H, FINE_NODES, FINE_PHI, $fine_first};
static const struct grid COARSE = {COARSE_STEPS, COARSE_SAMPLES, COARSE_H, COARSE_NODES, COARSE_PHI, $coarse_first};

/* What is asked for, and what counts as 1 there. */
struct task {
    double start[N], wanted[FIXED];
    double scales[ROWS]; /* that make the error dimensionless */
    double units[M];     /* of a natural control: what its inputs are divided by */
};

/* One control tried. */
struct place {
    double error, merit, residual[ROWS];
    int failure;  /* a status, or NONE: the end point is useless */
    int crossing; /* a status, or NONE: the path jumps across a surface that its equations cannot cross */
};

/* The inputs at the samples, samples x M. */
static void sample_controls(const struct grid *grid, const double *lambda, double *u)
{
    for (long long s = 0; s < grid->samples; ++s) {
        const double *phi = grid->phi + s * WIDTH;
        for (int i = 0; i < M; ++i) {
            const double *row = lambda + i * FUNCTIONS + (grid->first ? grid->first[s] : 0);
            double sum = 0.0;
            for (int k = 0; k < WIDTH; ++k)
                sum += row[k] * phi[k];
            u[s * M + i] = sum;
        }
    }
}

/* Derivatives by the coefficients, R x COLUMNS, from those by the controls at the samples. */
static void by_coefficients(const struct grid *grid, const double *gathered, double *sums, double *tangents)
{
    for (int q = 0; q < FUNCTIONS * R * M; ++q)
        sums[q] = 0.0;
    for (long long s = 0; s < grid->samples; ++s) {
        const double *phi = grid->phi + s * WIDTH, *rows = gathered + s * R * M;
        double *sum = sums + (grid->first ? grid->first[s] : 0) * R * M;
        for (int k = 0; k < WIDTH; ++k, sum += R * M)
            for (int q = 0; q < R * M; ++q)
                sum[q] += phi[k] * rows[q];
    }
    for (int r = 0; r < R; ++r)
        for (int i = 0; i < M; ++i)
            for (int k = 0; k < FUNCTIONS; ++k)
                tangents[r * COLUMNS + i * FUNCTIONS + k] = sums[(k * R + r) * M + i];
}
$surfaces
/* The error at a point: e in its units, E; a status, or NONE. */
static int compare(const struct task *task, const double *point, double *residual, double *error)
{
    double angles[ANGLES], weighted[ROWS];
    difference(point, task->wanted, residual, angles);
    for (int i = 0; i < TURNS; ++i)
        if (angles[i] > HALF_TURN)
            return ${upper}_ORIENTATION_AT_PI;
    for (int i = 0; i < ROWS; ++i)
        weighted[i] = WEIGHTS[i] * residual[i];
    *error = norm(ROWS, weighted);
    return isfinite(*error) ? NONE : ${upper}_NOT_FINITE;
}

/* Where a control leads. */
static void travel(const struct task *task, const double *lambda, struct ${name}_work *work, struct place *place)
{
    place->error = place->merit = HUGE_VAL;
    place->failure = place->crossing = NONE;
    sample_controls(&OWN, lambda, work->controls);
    for (int j = 0; j < N; ++j)
        work->states[j] = task->start[j];
    walk(STEPS, H, NODES, work->controls, work->states, work->samples);
    const int finite = all_finite((STEPS + 1) * N, work->states);$look
    if (!finite) {
        place->failure = ${lost};
        return;
    }
    place->failure = compare(task, work->states + STEPS * N, place->residual, &place->error);
    if (place->failure != NONE)
        return;
    for (int i = 0; i < ROWS; ++i)
        place->residual[i] *= task->scales[i];
    place->merit = norm(ROWS, place->residual);
    if (!isfinite(place->merit))
        place->failure = ${upper}_NOT_FINITE;
}

/* The derivative of e by the coefficients, of the path that was last travelled; whether it is finite. */
static int differentiate(const struct task *task, struct ${name}_work *work)
{$slopes
    pull(STEPS, H, NODES, SAMPLES, work->states + STEPS * N, work->tape, work->gathered);
    by_coefficients(&OWN, work->gathered, work->sums, work->tangents);
    for (int i = 0; i < ROWS; ++i)
        for (int j = 0; j < COLUMNS; ++j)
            work->jacobian[i * COLUMNS + j] = task->scales[i] * work->tangents[TANGENTS[i] * COLUMNS + j];
    return all_finite(ROWS * COLUMNS, work->jacobian);
}

/* Whether a path of other steps ends at the goal. */
static int reaches(const struct grid *grid, const struct task *task, const double *lambda, struct ${name}_work *work)
{
    const double *end = work->fine_states + grid->steps * N;
    double residual[ROWS], error = HUGE_VAL;
    sample_controls(grid, lambda, work->fine_controls);
    for (int j = 0; j < N; ++j)
        work->fine_states[j] = task->start[j];
    walk(grid->steps, grid->h, grid->nodes, work->fine_controls, work->fine_states, 0);
    return all_finite(N, end) && compare(task, end, residual, &error) == NONE && error <= ${upper}_TOLERANCE;
}

/* Whether what was reached is no artefact of its steps: finer ones reach it as well. Where steps as much coarser do,
 * in a sixteenth of the time, that is settled. */
static int confirmed(const struct task *task, const double *lambda, struct ${name}_work *work)
{
    return reaches(&COARSE, task, lambda, work) || reaches(&FINE, task, lambda, work);
}
""")

# singularity_crossings.first_crossing and nearest_approach
SURFACES = Template(r"""
/* A determinant at a state of the path; one that is not defined counts as zero. */
static double surface(const double *watched_there, int which)
{
    const double *numbers = watched_there + SURFACE_AT[which];
    const double value = $determinant;
    return isnan(value) ? 0.0 : value;
}

/* The status of the first determinant that changes sign along the path, or NONE. */
static int crossed(const struct ${name}_work *work, int finite)
{
    for (int which = 0; which < SURFACES; ++which) {
        double first = 0.0;
        for (int s = 0, begun = 0; s <= STEPS; ++s) {
            if (!finite && !all_finite(N, work->states + s * N))
                continue;
            const double value = surface(work->watched + s * W, which);
            first = begun ? first : value;
            begun = 1;
            if (!((first > 0.0 && value > 0.0) || (first < 0.0 && value < 0.0)))
                return SURFACE_STATUS[which];
        }
    }
    return NONE;
}

/* Of a path that is lost: the status of the first determinant that came near zero on its way. */
static int approached(const struct ${name}_work *work)
{
    for (int which = 0; which < SURFACES; ++which) {
        const double first = surface(work->watched, which);
        for (int s = 0; s <= STEPS; ++s)
            if (all_finite(N, work->states + s * N)
                && fabs(surface(work->watched + s * W, which) / first) < SINGULAR_BELOW)
                return SURFACE_STATUS[which];
    }
    return ${upper}_NOT_FINITE;
}
""")

LOOK = """
    watched(STEPS + 1, work->states, work->watched);
    place->crossing = crossed(work, finite);"""

SLOPES = """
    for (long long b = 0; b < BLOCKS; ++b)
        slopes(work->samples + b * (N + M) * L, work->samples + b * (N + M) * L + N * L, work->tape + b * E * L);"""
