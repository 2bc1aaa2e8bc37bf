/* Plans what is asked for on standard input, by a planner of `nhpocp export --format c-planner`.
 *
 * cc -DNAME=paper_planner -DUPPER=PAPER_PLANNER -DHEADER='"paper.h"' planner_driver.c paper.c -lm
 * ./a.out REPEATS TIMES reads a start, a goal and a first control (NaN: the planner's own) at a time and says on a line:
 * status, updates, evaluations, E, CPU seconds of a plan, the coefficients, the last state, and, at so many times from a
 * little before the start to a little after the end, joints and speeds. */
#include HEADER

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#define JOINED(a, b) a##b
#define JOIN(a, b) JOINED(a, b)
#define OURS(what) JOIN(NAME, what)
#define SIZE(what) JOIN(UPPER, what)

static int read_numbers(int count, double *numbers)
{
    for (int i = 0; i < count; ++i)
        if (scanf("%lf", numbers + i) != 1)
            return 0;
    return 1;
}

static void print_numbers(int count, const double *numbers)
{
    for (int i = 0; i < count; ++i)
        printf(" %.17g", numbers[i]);
}

int main(int count, char **words)
{
    const int repeats = count > 1 ? atoi(words[1]) : 1, times = count > 2 ? atoi(words[2]) : 0;
    double start[SIZE(_STATE)], goal[SIZE(_STATE)], initial[SIZE(_COEFFICIENTS)];
    struct OURS(_work) *work = malloc(sizeof *work);
    struct OURS(_plan) *plan = malloc(sizeof *plan);
    if (!work || !plan)
        return 1;
    while (read_numbers(SIZE(_STATE), start) && read_numbers(SIZE(_STATE), goal)
           && read_numbers(SIZE(_COEFFICIENTS), initial)) {
        const clock_t began = clock();
        for (int i = 0; i < repeats; ++i)
            OURS(_solve)(start, goal, isnan(initial[0]) ? 0 : initial, plan, work);
        printf("%s %d %d %.17g %.9g", OURS(_status_name)(plan->status), plan->updates, plan->evaluations, plan->error,
               (double)(clock() - began) / CLOCKS_PER_SEC / repeats);
        print_numbers(SIZE(_COEFFICIENTS), plan->coefficients);
        print_numbers(SIZE(_STATE), plan->states[SIZE(_STEPS)]);
#ifdef JOINTS
        for (int i = 0; i < times; ++i) {
            double joints[SIZE(_JOINTS)], speeds[SIZE(_JOINTS)];
            OURS(_at)(plan, (1.1 * i / (times - 1) - 0.05) * SIZE(_HORIZON), joints, speeds);
            print_numbers(SIZE(_JOINTS), joints);
            print_numbers(SIZE(_JOINTS), speeds);
        }
#else
        (void)times;
#endif
        putchar('\n');
    }
    free(plan);
    free(work);
    return 0;
}
