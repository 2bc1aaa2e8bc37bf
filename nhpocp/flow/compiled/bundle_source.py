"""The ends of many paths at once as a C text: CasADi's code of the functions of a `Scheme`, and the loops around them.

Lanes are controls, side by side in memory, so that a compiler makes vector instructions even of the steps, which can
only follow one another. The slopes of a step are worked out where rows are pulled back through it, and never stored.
"""

from __future__ import annotations

from nhpocp.flow.compiled.sweep_source import LANES, lane_function, straight_lines
from nhpocp.flow.runge_kutta import Scheme

# of the functions of a Scheme: their arguments and results
_FUNCTIONS = {
    "step": (("y", "h", "u"), ("next", "points")),
    "slopes": (("y", "u"), ("tape",)),
    "pulled_row": (("c", "tape", "h"), ("before", "gradients")),
    "observed": (("y",), ("matrix",)),
    "watched": (("y",), ("numbers",)),
}

_LOOPS = r"""
static void copy(long long size, const double *restrict a, double *restrict to) {
  for (long long j = 0; j < size; ++j) to[j] = a[j];
}

/* the wanted rows at y pulled back through all steps: what they gather at the controls, count x R x M x L, zero
   before */
static void pull(long long steps, const double *h, const long long *nodes, const double *u, const double *points,
                 const double *y, double *gathered, double *work) {
  double *matrix = work, *tape = matrix + N * R * L, *now = tape + 4 * E * L, *before = now + R * N * L;
  double g[3 * M * L], hs[L];
  observed(y, matrix);
  for (int r = 0; r < R; ++r)
    for (int j = 0; j < N; ++j) copy(L, matrix + (j * R + r) * L, now + (r * N + j) * L);
  for (long long k = steps - 1; k >= 0; --k) {
    for (int i = 0; i < 4; ++i)
      slopes(points + (4 * k + i) * N * L, u + nodes[3 * k + (i + 1) / 2] * M * L, tape + i * E * L);
    for (int l = 0; l < L; ++l) hs[l] = h[k];
    for (int r = 0; r < R; ++r) {
      pulled_row(now + r * N * L, tape, hs, before + r * N * L, g);
      for (int i = 0; i < 3; ++i) {
        double *at = gathered + (nodes[3 * k + i] * R + r) * M * L;
        for (int j = 0; j < M * L; ++j) at[j] += g[i * M * L + j];
      }
    }
    double *t = now; now = before; before = t;
  }
}

/* groups: of L controls each, u groups x count x M x L, from one start. nodes: for each step, which of the count stand
   at its start, middle and end. ends: groups x N x L; where wanted, watched_at: groups x (steps + 1) x W x L, and
   gathered, the derivatives of the observed rows at the ends by all controls: groups x count x R x M x L.
   work: (4 steps N + 3 N R + 4 E) L doubles. */
CASADI_SYMBOL_EXPORT void nhpocp_bundle(long long steps, const double *h, const long long *nodes, long long count,
                                        const double *start, long long groups, const double *controls, double *work,
                                        double *ends, double *watched_at, double *gathered) {
  double *points = work, *more = points + 4 * steps * N * L;
  double y[2][N * L], u3[3 * M * L], hs[L];
  for (long long b = 0; b < groups; ++b) {
    const double *u = controls + b * count * M * L;
    double *now = y[0], *next = y[1], *w = watched_at + b * (steps + 1) * W * L;
    for (int j = 0; j < N * L; ++j) now[j] = start[j / L];
    if (watched_at) watched(now, w);
    for (long long k = 0; k < steps; ++k) {
      for (int i = 0; i < 3; ++i) copy(M * L, u + nodes[3 * k + i] * M * L, u3 + i * M * L);
      for (int l = 0; l < L; ++l) hs[l] = h[k];
      step(now, hs, u3, next, points + 4 * k * N * L);
      double *t = now; now = next; next = t;
      if (watched_at) watched(now, w + (k + 1) * W * L);
    }
    copy(N * L, now, ends + b * N * L);
    if (!gathered) continue;
    double *at = gathered + b * count * R * M * L;
    for (long long j = 0; j < count * R * M * L; ++j) at[j] = 0.0;
    pull(steps, h, nodes, u, points, now, at, more);
  }
}
"""


def c_source(scheme: Scheme) -> str:
    """The C text of `nhpocp_bundle` for one scheme.

    Errors: `NotCompilableError` where CasADi's code is more than straight lines.
    """
    functions = {name: getattr(scheme, name) for name in _FUNCTIONS}
    head, bodies = straight_lines([function for function in functions.values() if function.nnz_out()])
    found = iter(bodies)
    texts = [
        lane_function(name, *_FUNCTIONS[name], next(found) if function.nnz_out() else "")
        for name, function in functions.items()
    ]
    sizes = {
        "N": scheme.size,
        "M": scheme.inputs,
        "R": scheme.rows,
        "E": scheme.entries,
        "W": scheme.watches,
        "L": LANES,
    }
    letters = ", ".join(f"{letter} = {size}" for letter, size in sizes.items())
    return f"{head}\nenum {{ {letters} }};\n{''.join(texts)}\n{_LOOPS}"
