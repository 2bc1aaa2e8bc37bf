"""The continuation in C: the loop of [Paper] eq. (17) with steps inside a trust region, and how it ends."""

from __future__ import annotations

from string import Template

# what counts as 1 (`natural_scales`), and the coordinates in which a control is measured (`Coordinates`)
SCALES = Template(r"""
static double span(const double *start, const double *goal, int unit, double otherwise)
{
    double widest = 0.0;
    for (int j = 0; j < FIXED; ++j)
        if (POINT_UNITS[j] == unit)
            widest = fmax(widest, fabs(goal[FIXED_AT[j]] - start[FIXED_AT[j]]));
    return widest > LEAST_SPAN * otherwise ? widest : otherwise;
}

static void set_task(const double *start, const double *goal, struct task *task)
{
    const double length = $length;
    const double of[3] = {span(start, goal, NUMBER, 1.0), length, 1.0};
    for (int j = 0; j < N; ++j)
        task->start[j] = start[j];
    for (int j = 0; j < FIXED; ++j)
        task->wanted[j] = goal[FIXED_AT[j]];
    for (int i = 0; i < ROWS; ++i)
        task->scales[i] = ROW_UNITS[i] == LENGTH ? 1.0 / length : 1.0;
    for (int i = 0; i < M; ++i)
        task->units[i] = of[INPUT_UNITS[i]] / TIME;$common_unit
}
$metric""")

COMMON_UNIT = """
    double largest = task->units[0];
    for (int i = 1; i < M; ++i)
        largest = fmax(largest, task->units[i]);
    for (int i = 0; i < M; ++i)
        task->units[i] = ROOT_OF_HORIZON * largest;"""

# |λ|, in units of a natural control
BY_COEFFICIENTS = r"""
static void to_metric(const struct task *task, const double *lambda, double *z)
{
    for (int i = 0; i < COLUMNS; ++i)
        z[i] = lambda[i] / task->units[i / FUNCTIONS];
}

static void from_metric(const struct task *task, const double *z, double *lambda)
{
    for (int i = 0; i < COLUMNS; ++i)
        lambda[i] = z[i] * task->units[i / FUNCTIONS];
}

static void row_in_metric(const struct task *task, const double *row, double *there)
{
    from_metric(task, row, there);
}
"""

# ∫ |u|² dt = |GRAM_ROOTᵀ λ|², GRAM_ROOT lower triangular
BY_GRAM = r"""
static void to_metric(const struct task *task, const double *lambda, double *z)
{
    for (int i = 0; i < M; ++i)
        for (int k = 0; k < FUNCTIONS; ++k) {
            double sum = 0.0;
            for (int j = k; j < FUNCTIONS; ++j)
                sum += GRAM_ROOT[j][k] * lambda[i * FUNCTIONS + j];
            z[i * FUNCTIONS + k] = sum / task->units[i];
        }
}

static void from_metric(const struct task *task, const double *z, double *lambda)
{
    for (int i = 0; i < M; ++i)
        for (int k = FUNCTIONS - 1; k >= 0; --k) {
            double sum = z[i * FUNCTIONS + k] * task->units[i];
            for (int j = k + 1; j < FUNCTIONS; ++j)
                sum -= GRAM_ROOT[j][k] * lambda[i * FUNCTIONS + j];
            lambda[i * FUNCTIONS + k] = sum / GRAM_ROOT[k][k];
        }
}

static void row_in_metric(const struct task *task, const double *row, double *there)
{
    for (int i = 0; i < M; ++i)
        for (int k = 0; k < FUNCTIONS; ++k) {
            double sum = row[i * FUNCTIONS + k] * task->units[i];
            for (int j = 0; j < k; ++j)
                sum -= GRAM_ROOT[k][j] * there[i * FUNCTIONS + j];
            there[i * FUNCTIONS + k] = sum / GRAM_ROOT[k][k];
        }
}
"""

# Continuation, Adaptive and StopCriteria
LOOP = Template(r"""
/* What the stop criteria know of the controls that were accepted: the least error of all and of those before the
 * window, and the errors and predicted fractions within it. */
struct history {
    int count;
    double first, best, before, errors[WINDOW], fractions[WINDOW];
};

static void remember(struct history *history, double error, double fraction)
{
    const int at = history->count % WINDOW;
    if (!history->count++) {
        history->first = history->best = error;
        history->before = HUGE_VAL;
    } else if (history->count > WINDOW) {
        history->before = fmin(history->before, history->errors[at]);
    }
    history->best = fmin(history->best, error);
    history->errors[at] = error;
    history->fractions[at] = fraction;
}

static int stagnated(const struct history *history)
{
    double predicted = 0.0;
    if (history->count <= WINDOW)
        return 0;
    for (int i = 0; i < WINDOW; ++i)
        predicted += history->fractions[i];
    return !(history->best > 0.0 && log(history->before / history->best) >= STAGNATION * predicted);
}

/* The linear model at a control, decomposed: values, and e along them; a status, or NONE. */
static int linearise(const struct task *task, const struct place *here, struct ${name}_work *work, double *values,
                     double *along)
{
    double least, largest;
    for (int i = 0; i < ROWS; ++i) {
        row_in_metric(task, work->jacobian + i * COLUMNS, work->rows + i * COLUMNS);
        along[i] = here->residual[i];
    }
    if (!all_finite(ROWS * COLUMNS, work->rows))
        return ${upper}_NOT_FINITE;
    decompose(ROWS, COLUMNS, work->rows, along, values);
    extremes(ROWS, values, &least, &largest);
    return least > RANK * largest ? NONE : ${upper}_RANK_DEFICIENT;
}

/* The best step within the radius: what is added to the coefficients, its length and the fraction of |e| that it is
 * predicted to remove. */
static double find_step(const struct task *task, const double *rows, const double *values, const double *along,
                        double merit, double radius, double *change, double *size)
{
    double inner[ROWS], left[ROWS], z[COLUMNS];
    within_radius(values, along, radius, inner);
    for (int j = 0; j < COLUMNS; ++j)
        z[j] = 0.0;
    for (int i = 0; i < ROWS; ++i) {
        left[i] = along[i] - values[i] * inner[i];
        for (int j = 0; j < COLUMNS && inner[i] != 0.0; ++j)
            z[j] -= inner[i] / values[i] * rows[i * COLUMNS + j];
    }
    from_metric(task, z, change);
    *size = norm(COLUMNS, z);
    return (merit - norm(ROWS, left)) / merit;
}

static void accept(const struct place *place, const double *lambda, const struct ${name}_work *work,
                   struct ${name}_plan *plan)
{
    plan->error = place->error;
    for (int j = 0; j < COLUMNS; ++j)
        plan->coefficients[j] = lambda[j];
    for (int s = 0; s <= STEPS; ++s)
        for (int j = 0; j < N; ++j)
            plan->states[s][j] = work->states[s * N + j];
}

/* From a control to the goal; a status. */
static int search(const struct task *task, const double *initial, struct ${name}_plan *plan, struct ${name}_work *work)
{
    double values[ROWS], along[ROWS], change[COLUMNS], next[COLUMNS];
    double radius = 0.0, smallest = 0.0, fraction = 0.0;
    struct history history = {0, 0.0, 0.0, 0.0, {0.0}, {0.0}};
    struct place here;
    plan->evaluations = 1;
    travel(task, initial, work, &here);
    accept(&here, initial, work, plan);
    if (here.failure == NONE && !(here.error < ${upper}_TOLERANCE) && !differentiate(task, work))
        here.failure = here.crossing != NONE ? here.crossing : ${lost_here};
    for (;;) {
        int status;
        if (here.failure != NONE)
            return here.failure;
        remember(&history, here.error, fraction);
        if (here.error < ${upper}_TOLERANCE)
            return here.crossing != NONE ? here.crossing : ${upper}_CONVERGED;
        status = here.error > DIVERGED_ABOVE * (1.0 + history.first) ? ${upper}_DIVERGED
                                                                     : linearise(task, &here, work, values, along);
        if (status != NONE)
            return here.crossing != NONE ? here.crossing : status;
        if (plan->evaluations >= ${upper}_EVALUATIONS)
            return ${upper}_ITERATION_LIMIT;
        if (stagnated(&history))
            return ${upper}_STAGNATED;
        if (history.count == 1) {
            to_metric(task, plan->coefficients, change);
            radius = FIRST_RADIUS * (1.0 + norm(COLUMNS, change));
            smallest = SMALLEST * radius;
        }
        for (;;) {
            struct place trial;
            double size, gain = -HUGE_VAL;
            if (!(radius > smallest))
                return ${upper}_STAGNATED;
            fraction = find_step(task, work->rows, values, along, here.merit, radius, change, &size);
            if (!(fraction > LEAST_PREDICTED))
                return ${upper}_STAGNATED;
            if (plan->evaluations >= ${upper}_EVALUATIONS)
                return ${upper}_ITERATION_LIMIT;
            ++plan->evaluations;
            for (int j = 0; j < COLUMNS; ++j)
                next[j] = plan->coefficients[j] + change[j];
            travel(task, next, work, &trial);
            if (trial.failure == NONE && trial.crossing == NONE)
                gain = (here.merit - trial.merit) / (fraction * here.merit);
            if (gain > LEAST_GAIN && !(trial.error < ${upper}_TOLERANCE) && !differentiate(task, work))
                gain = -HUGE_VAL;
            radius = next_radius(radius, size, gain);
            if (gain > LEAST_GAIN) {
                here = trial;
                break;
            }
        }
        ++plan->updates;
        accept(&here, next, work, plan);
    }
}
""")
