r"""One sweep over all steps as a C text: CasADi's code of the functions of a `Scheme`, and the loops around them.

CasADi writes straight-line code for one sample. What is independent of each other is looped over innermost, side by
side in memory, so that a compiler makes vector instructions of it: the stages of all steps where f is differentiated,
the rows where they are pulled back. The steps themselves can only follow one another.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

import casadi as ca

from nhpocp.flow.compiled.kernel_cache import NotCompilableError
from nhpocp.flow.runge_kutta import Scheme

LANES = 8  # samples side by side

_FUNCTION = re.compile(r"\nstatic int casadi_f\d+\(.*?\) \{\n(.*?)\n  return 0;\n\}", re.DOTALL)
_INPUT = re.compile(r"arg\[(\d)\]\? arg\[\1\]\[(\d+)\] : 0")
_OUTPUT = re.compile(r"if \(res\[(\d)\]!=0\) res\[\1\]\[(\d+)\]=")
_OTHER = re.compile(r"\b(arg|res|iw|w)\b")
_HELPER = re.compile(r"^casadi_real casadi_", re.MULTILINE)

_LANE_FUNCTION = r"""
static void {name}({declared}) {{
#pragma omp simd
  for (int l = 0; l < L; ++l) {{
{defined}
{body}
{undefined}
  }}
}}
"""

_LOOPS = r"""
enum {{ N = {size}, M = {inputs}, R = {rows}, E = {entries}, L = {lanes}, LR = {row_lanes} }};

/* compilers leave out what is called twice, and with it a third of the speed */
#define INLINED static inline __attribute__((always_inline))

/* where value j of sample s stands among samples of `size` values each */
#define AT(s, j, size) ((((s) / L) * (size) + (j)) * L + (s) % L)

/* y+ and the points of the stages; u: three controls */
INLINED void step(const double *restrict y, double h, const double *const *restrict u,
                  double *restrict next, double *restrict points) {{
#define X0(j) y[j]
#define X1(j) h
#define X2(j) u[(j) / M][(j) % M]
#define Y0(j) next[j]
#define Y1(j) points[j]
{step}
#undef X0
#undef X1
#undef X2
#undef Y0
#undef Y1
}}

/* [F, B] at L samples */
static void slopes(const double *restrict samples, double *restrict tape) {{
#pragma omp simd
  for (int l = 0; l < L; ++l) {{
#define X0(j) samples[(j) * L + l]
#define X1(j) samples[(N + (j)) * L + l]
#define Y0(j) tape[(j) * L + l]
{slopes}
#undef X0
#undef X1
#undef Y0
  }}
}}

/* rows before a step and their derivatives by its controls; tape: that of the step's first stage */
INLINED void pull(const double *restrict c, const double *restrict tape, double h,
                  double *restrict before, double *restrict gradients) {{
#pragma omp simd
  for (int l = 0; l < LR; ++l) {{
#define X0(j) c[(j) * LR + l]
#define X1(j) tape[((j) % E) * L + (j) / E]
#define X2(j) h
#define Y0(j) before[(j) * LR + l]
#define Y1(j) gradients[(j) * LR + l]
{pulled}
#undef X0
#undef X1
#undef X2
#undef Y0
#undef Y1
  }}
}}

/* numbers at so many points of the path */
static void watch(long long points, const double *restrict y, double *restrict watched) {{
#pragma omp simd
  for (long long k = 0; k < points; ++k) {{
#define X0(j) y[k * N + (j)]
#define Y0(j) watched[k * {watches} + (j)]
{watched}
#undef X0
#undef Y0
  }}
}}

static void observe(const double *restrict y, double *restrict matrix) {{
#define X0(j) y[j]
#define Y0(j) matrix[j]
{observed}
#undef X0
#undef Y0
}}

/* y: steps + 1 states, the first given. nodes: for each step, which of the count controls u (count x M) stand at its
   start, middle and end. gathered: for each stop, the derivatives of the observed rows there by all these controls,
   stops x count x R x M; without stops none is worked out. watched: the watched numbers at every state, with stops.
   work: (N + M + E) L doubles for every L samples, 4 samples a step. */
CASADI_SYMBOL_EXPORT void nhpocp_sweep(long long steps, const double *h, const long long *nodes,
                                       long long count, const double *u, double *y,
                                       long long stops, const long long *stop,
                                       double *work, double *gathered, double *watched) {{
  const long long blocks = (4 * steps + L - 1) / L;
  double *samples = work, *tape = samples + blocks * (N + M) * L;
  double points[4 * N], matrix[R * N], c[2][N * LR], g[3 * M * LR];
  for (long long k = 0; k < steps; ++k) {{
    const double *const at[3] = {{u + M * nodes[3 * k], u + M * nodes[3 * k + 1], u + M * nodes[3 * k + 2]}};
    const double *const control[4] = {{at[0], at[1], at[1], at[2]}};
    step(y + N * k, h[k], at, y + N * (k + 1), points);
    for (int i = 0; stops && i < 4; ++i) {{
      double *sample = samples + AT(4 * k + i, 0, N + M);
      for (int j = 0; j < N; ++j) sample[j * L] = points[i * N + j];
      for (int j = 0; j < M; ++j) sample[(N + j) * L] = control[i][j];
    }}
  }}
  if (stops) watch(steps + 1, y, watched);
  for (long long b = 0; stops && b < blocks; ++b) slopes(samples + b * (N + M) * L, tape + b * E * L);
  for (long long s = 0; s < stops; ++s) {{
    double *now = c[0], *before = c[1], *gradients = gathered + s * count * R * M;
    for (long long q = 0; q < count * R * M; ++q) gradients[q] = 0.0;
    observe(y + N * stop[s], matrix);
    for (int j = 0; j < N; ++j)
      for (int r = 0; r < LR; ++r) now[j * LR + r] = r < R ? matrix[j * R + r] : 0.0;
    for (long long k = stop[s] - 1; k >= 0; --k) {{
      pull(now, tape + AT(4 * k, 0, E), h[k], before, g);
      double *t = now; now = before; before = t;
      for (int i = 0; i < 3; ++i) {{
        double *at = gradients + nodes[3 * k + i] * R * M;
        for (int r = 0; r < R; ++r)
          for (int j = 0; j < M; ++j) at[r * M + j] += g[(i * M + j) * LR + r];
      }}
    }}
  }}
}}
"""


def c_source(scheme: Scheme) -> str:
    """The C text of `nhpocp_sweep` for one scheme.

    Errors: `NotCompilableError` where CasADi's code is more than straight lines.
    """
    functions = {
        "step": scheme.step,
        **({"slopes": scheme.slopes} if scheme.entries else {}),
        "pulled": scheme.pulled_row,
        "observed": scheme.observed,
        **({"watched": scheme.watched} if scheme.watches else {}),
    }
    head, bodies = straight_lines(list(functions.values()))
    loops = _LOOPS.format(
        size=scheme.size,
        inputs=scheme.inputs,
        rows=scheme.rows,
        entries=scheme.entries,
        lanes=LANES,
        row_lanes=_row_lanes(scheme.rows),
        watches=scheme.watches,
        **{"slopes": "", "watched": "", **dict(zip(functions, bodies, strict=True))},
    )
    return head + "\n" + loops


def straight_lines(functions: Sequence[ca.Function]) -> tuple[str, list[str]]:
    """CasADi's helpers and each function's code, its arguments and results behind the macros X0, X1, … and Y0, Y1, ….

    Errors: `NotCompilableError` where that is more than straight lines.
    """
    generator = ca.CodeGenerator("nhpocp_kernel")
    for function in functions:
        generator.add(function)
    text = generator.dump()
    found = _FUNCTION.findall(text)
    if len(found) != len(functions):
        raise NotCompilableError("CasADi's code for these functions is not straight lines")
    # CasADi's helpers are exported, and so never inlined
    head = _HELPER.sub(
        "static inline casadi_real casadi_", text[: text.index(f"\n/* {functions[0].name()}:(")]
    )
    return head, [_accessed(body) for body in found]


def lane_function(name: str, arguments: Sequence[str], results: Sequence[str], body: str) -> str:
    """A C function of L samples side by side, number j of sample l at [j L + l], from code as of `straight_lines`."""
    macros = [(f"X{i}", letter) for i, letter in enumerate(arguments)]
    macros += [(f"Y{i}", letter) for i, letter in enumerate(results)]
    declared = [f"const double *restrict {letter}" for letter in arguments]
    declared += [f"double *restrict {letter}" for letter in results]
    return _LANE_FUNCTION.format(
        name=name,
        declared=", ".join(declared),
        defined="\n".join(f"#define {macro}(j) {letter}[(j) * L + l]" for macro, letter in macros),
        body=body,
        undefined="\n".join(f"#undef {macro}" for macro, _ in macros),
    )


def _row_lanes(rows: int) -> int:
    return next((lanes for lanes in (1, 2, 4) if rows <= lanes), -(-rows // LANES) * LANES)


def _accessed(body: str) -> str:
    """A function's code with its arguments and results behind the macros X and Y."""
    body = _OUTPUT.sub(r"Y\1(\2)=", _INPUT.sub(r"X\1(\2)", body))
    if _OTHER.search(body):
        raise NotCompilableError("CasADi's code for this function is not straight lines")
    return body
