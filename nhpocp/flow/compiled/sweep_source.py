r"""Sweeps over all steps as a C text: CasADi's code of the functions of a `Scheme`, and the loops around them.

What is independent of each other is looped over innermost: the stages of all steps where f is differentiated, the rows
where they are pulled back. The steps themselves can only follow one another.
"""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca

from nhpocp.flow.compiled.c_functions import (
    LANES,
    Lanes,
    functions_text,
    helpers_alone,
    sizes_text,
)
from nhpocp.flow.compiled.kernel_cache import NotCompilableError
from nhpocp.flow.runge_kutta import Scheme

_FUNCTIONS = {
    "step": Lanes("y h u", "next points", "1", inlined=True),
    "step_abreast": Lanes("y h u", "next points"),
    "slopes": Lanes("y u", "tape"),
    "pulled_row": Lanes(
        "c tape h", "before gradients", "LR", {"tape": "(j) % E * L + (j) / E", "h": "0"}, inlined=True
    ),
    "observed": Lanes("y", "matrix", "1"),
    "watched": Lanes(
        "y", "numbers", "points", {"y": "l * N + (j)", "numbers": "l * W + (j)"}, "long long points"
    ),
}

_NUMBERS = """
static const double *NUMBERS; /* of the call that is being answered: a kernel answers one at a time */
"""

_WALK = r"""
/* where value j of sample s stands among samples of `size` values each */
#define AT(s, j, size) ((((s) / L) * (size) + (j)) * L + (s) % L)

/* one path, and what its stages are at; without samples nobody asks for that */
static void walk(long long steps, const double *h, const long long *nodes, const double *u, double *y,
                 double *samples) {
  double points[S * N], seen[K * M];
  for (long long k = 0; k < steps; ++k) {
    for (int i = 0; i < K; ++i)
      for (int j = 0; j < M; ++j) seen[i * M + j] = u[nodes[K * k + i] * M + j];
    step(y + N * k, h + k, seen, y + N * (k + 1), points);
    for (int i = 0; samples && i < S; ++i) {
      double *sample = samples + AT(SLOTS * k + i, 0, N + M);
      for (int j = 0; j < N; ++j) sample[j * L] = points[i * N + j];
      for (int j = 0; j < M; ++j) sample[(N + j) * L] = seen[PLACE[i] * M + j];
    }
  }
}
"""

_WALK_ABREAST = r"""
/* L paths, as many doubles apart as the strides say */
static void walk_abreast(long long steps, const double *h, const long long *nodes, const double *u, double *y,
                         double *samples, long long u_stride, long long y_stride, long long stride) {
  double points[S * N * L], seen[K * M * L], hs[L], now[N * L], next[N * L];
  for (int j = 0; j < N; ++j) for (int l = 0; l < L; ++l) now[j * L + l] = y[l * y_stride + j];
  for (long long k = 0; k < steps; ++k) {
    for (int l = 0; l < L; ++l) hs[l] = h[k];
    for (int i = 0; i < K; ++i)
      for (int j = 0; j < M; ++j)
        for (int l = 0; l < L; ++l) seen[(i * M + j) * L + l] = u[l * u_stride + nodes[K * k + i] * M + j];
    step_abreast(now, hs, seen, next, points);
    for (int l = 0; l < L; ++l)
      for (int j = 0; j < N; ++j) y[l * y_stride + (k + 1) * N + j] = now[j * L + l] = next[j * L + l];
    for (int l = 0; samples && l < L; ++l)
      for (int i = 0; i < S; ++i) {
        double *sample = samples + l * stride + AT(SLOTS * k + i, 0, N + M);
        for (int j = 0; j < N; ++j) sample[j * L] = points[(i * N + j) * L + l];
        for (int j = 0; j < M; ++j) sample[(N + j) * L] = seen[(PLACE[i] * M + j) * L + l];
      }
  }
}
"""

_PULL = r"""
/* the wanted rows at y pulled back through so many steps: what they gather at the controls, count x R x M */
static void pull(long long steps, const double *h, const long long *nodes, long long count, const double *y,
                 const double *tape, double *gathered) {
  double matrix[R * N], c[2][N * LR], g[K * M * LR], *now = c[0], *before = c[1];
  for (long long q = 0; q < count * R * M; ++q) gathered[q] = 0.0;
  observed(y, matrix);
  for (int j = 0; j < N; ++j)
    for (int r = 0; r < LR; ++r) now[j * LR + r] = r < R ? matrix[j * R + r] : 0.0;
  for (long long k = steps - 1; k >= 0; --k) {
    pulled_row(now, tape + AT(SLOTS * k, 0, E), h + k, before, g);
    double *t = now; now = before; before = t;
    for (int i = 0; i < K; ++i) {
      double *at = gathered + nodes[K * k + i] * R * M;
      for (int r = 0; r < R; ++r)
        for (int j = 0; j < M; ++j) at[r * M + j] += g[(i * M + j) * LR + r];
    }
  }
}
"""

_SWEEP = r"""
/* numbers: what `numbers_apart` has taken out. paths: of so many y and u. y: steps + 1 states each, the first given.
   nodes: for each step, which of the count controls u (count x M) it sees. gathered: for each stop, the derivatives of
   the observed rows there by all these controls, stops x count x R x M; without stops none is worked out. seen: what is
   watched at every state, with stops. work: E L doubles for every L samples, and (N + M) L for each of the paths, up to
   L; a step has as many samples as its stages and, so that L hold whole steps, up to a power of two. */
CASADI_SYMBOL_EXPORT void nhpocp_sweep(const double *numbers, long long paths, long long steps, const double *h,
                                       const long long *nodes, long long count, const double *u, double *y,
                                       long long stops, const long long *stop,
                                       double *work, double *gathered, double *seen) {
  NUMBERS = numbers;
  const long long blocks = (SLOTS * steps + L - 1) / L, states = (steps + 1) * N, stride = blocks * (N + M) * L;
  double *tape = work, *samples = stops ? tape + blocks * E * L : 0;
  for (long long p = 0; p < paths; ++p) {
    const int lane = p < paths / L * L ? p % L : 0;
    const double *sample = stops ? samples + lane * stride : 0;
    if (p >= paths / L * L) walk(steps, h, nodes, u, y, samples);
    else if (lane == 0) walk_abreast(steps, h, nodes, u, y, samples, count * M, states, stride);
    if (stops) watched(steps + 1, y, seen);
    for (long long b = 0; stops && b < blocks; ++b, sample += (N + M) * L)
      slopes(sample, sample + N * L, tape + b * E * L);
    for (long long s = 0; s < stops; ++s, gathered += count * R * M)
      pull(stop[s], h, nodes, count, y + N * stop[s], tape, gathered);
    u += count * M;
    y += states;
    seen += (steps + 1) * W;
  }
}
"""


def c_source(scheme: Scheme) -> str:
    """The C text of `nhpocp_sweep` for one scheme.

    Errors: `NotCompilableError` where CasADi's code is more than straight lines, or a step of more than `LANES` stages.
    """
    head, texts = functions_text(
        {name: (getattr(scheme, name.removesuffix("_abreast")), lanes) for name, lanes in _FUNCTIONS.items()}
    )
    return f"{head}{_NUMBERS}{_letters_text(scheme)}{texts}{_WALK}{_WALK_ABREAST}{_PULL}{_SWEEP}"


def path_source(scheme: Scheme, others: Mapping[str, tuple[ca.Function, Lanes]]) -> str:
    """C99 of `walk` and `pull`, for one path at a time, and of other functions, all static: a part of somebody's text.

    Its functions are `c_source`'s, and those without results are left out. Errors: as of `c_source`.
    """
    ours = {name: (getattr(scheme, name), _FUNCTIONS[name]) for name in _FUNCTIONS if name != "step_abreast"}
    giving = {name: each for name, each in (ours | dict(others)).items() if each[0].nnz_out()}
    head, texts = functions_text(giving, pragma="")
    return f"{helpers_alone(head)}{_letters_text(scheme)}{texts}{_WALK}{_PULL}"


def _letters_text(scheme: Scheme) -> str:
    """What the loops call the sizes of a scheme. Errors: `NotCompilableError` for a step of too many stages."""
    if slots(scheme) > LANES:
        raise NotCompilableError(f"a step of {scheme.tableau.stages} stages has more than {LANES}")
    row_lanes = next((lanes for lanes in (1, 2, 4) if scheme.rows <= lanes), -(-scheme.rows // LANES) * LANES)
    letters = {"N": scheme.size, "M": scheme.inputs, "R": scheme.rows, "LR": row_lanes, "L": LANES}
    letters |= {"E": scheme.entries, "W": scheme.watches, "SLOTS": slots(scheme)}
    return sizes_text(scheme.tableau, **letters)


def slots(scheme: Scheme) -> int:
    """Samples that a step takes: its stages, up to a power of two."""
    return 1 << (scheme.tableau.stages - 1).bit_length()
