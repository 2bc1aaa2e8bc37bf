"""The header of a planner in C."""

from __future__ import annotations

from string import Template

HEADER = Template("""\
/* Written by $signature. $name plans motions of $title ($model).
 *
 *   struct ${name}_work work;        $kilobytes kB to work in: static, or wherever there is room; one for each thread
 *   struct ${name}_plan plan;
 *   if (${name}_solve(start, goal, 0, &plan, &work) == ${upper}_CONVERGED)
 *       ... plan.coefficients$example_use
 *
 * It takes the way of nhpocp's Jacobian method with $rule, $steps steps of RK4 over the horizon
 * ($horizon [$time]) and the tolerance $tolerance, and gives the same coefficients. Nothing is allocated or kept
 * between calls; at most ${upper}_EVALUATIONS controls are tried. C99, needs libm:
 *
 *   cc -O3 -march=native -c $stem.c
 *   cc -O3 -march=native -D${upper}_EXAMPLE $stem.c -lm && ./a.out        (plans the problem of the file)
 *
 * A pose is ${upper}_STATE numbers [length: $length, angle: rad]:
$state$held
 * A control is ${upper}_INPUTS inputs times ${upper}_FUNCTIONS coefficients, row by row. The inputs, units over $time:
$inputs
 * over the functions $functions. */
#ifndef ${upper}_H
#define ${upper}_H

#ifdef __cplusplus
extern "C" {
#endif

#define ${upper}_STATE $size
#define ${upper}_INPUTS $input_count
#define ${upper}_FUNCTIONS $function_count
#define ${upper}_COEFFICIENTS $coefficients
#define ${upper}_STEPS $steps
#define ${upper}_TIMES $times
$joint_define#define ${upper}_HORIZON $horizon
#define ${upper}_TOLERANCE $tolerance
#define ${upper}_EVALUATIONS $evaluations

/* how a plan can end: nhpocp's outcomes */
enum ${name}_status {
$statuses
};

struct ${name}_plan {
    enum ${name}_status status;
    int updates;     /* of the control */
    int evaluations; /* controls that were tried */
    double error;    /* E at the end: lengths over $error_length, and angles [rad] */
    /* the last control, which is the plan if it converged */
    double coefficients[${upper}_COEFFICIENTS];
    /* where it leads, at ${name}_times */
    double states[${upper}_TIMES][${upper}_STATE];$joint_fields
};

/* Room; what is in it means nothing between calls. */
struct ${name}_work {
    double states[$states], controls[$controls], samples[$samples], tape[$tape];
    double gathered[$gathered], sums[$sums], tangents[$tangents], jacobian[$jacobian], rows[$jacobian];$watched_field
    double fine_states[$fine_states], fine_controls[$fine_controls];
};

/* The file's own poses and the control that every plan begins with, unless another is given. */
extern const double ${name}_start[${upper}_STATE];
extern const double ${name}_goal[${upper}_STATE];
extern const double ${name}_initial[${upper}_COEFFICIENTS];
extern const double ${name}_times[${upper}_TIMES];

/* Plans from a start to a goal$free, beginning with a control, or with ${name}_initial if that is null. */
enum ${name}_status ${name}_solve(
    const double start[${upper}_STATE], const double goal[${upper}_STATE],
    const double *initial, struct ${name}_plan *plan, struct ${name}_work *work);

/* "converged" and so on. */
const char *${name}_status_name(enum ${name}_status status);
$rotations$joint_functions
#ifdef __cplusplus
}
#endif

#endif
""")

JOINT_FIELDS = Template("""
    /* $joint_words, at ${name}_times, and their rates at the start and the end of every step */
    double joints[${upper}_TIMES][${upper}_JOINTS];
    double speeds[${upper}_STEPS][2][${upper}_JOINTS];""")

JOINT_FUNCTIONS = Template("""
/* Joints and their rates at time t of a plan, by cubic Hermite interpolation; before the start and after the end it
 * rests at that place. Either may be null. The joints:
$joints
$timing */
void ${name}_at(
    const struct ${name}_plan *plan, double t, double joints[${upper}_JOINTS], double speeds[${upper}_JOINTS]);
""")

DRIFTLESS = """\
 * The path may be run in any other time s, and from rest to rest: at t = T p(s/D) with p(z) = z^3 (10 - 15 z + 6 z^2)
 * over a duration D, at speeds that are p'(s/D) T/D times these."""
DRIFTING = " * A system that moves by itself has no other timing than this."

ROTATIONS = Template("""
/* The nine numbers of a rotation, body to base and row by row: Rz(yaw) Ry(pitch) Rx(roll) [rad], or of a unit
 * quaternion w, x, y, z. */
void ${name}_rotation_of_rpy(double roll, double pitch, double yaw, double rotation[9]);
void ${name}_rotation_of_quaternion(double w, double x, double y, double z, double rotation[9]);
""")

HELD = """
 * What the machine's joints hold has to be so at the start: that is not looked at."""
