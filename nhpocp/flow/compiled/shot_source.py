r"""All intervals of an NLP as a C text: CasADi's code of the parts of a `Shot` and of their derivatives, looped over.

CasADi writes each part (y, s) ↦ b once, and its derivative along a direction, its derivatives by y and s weighted with
multipliers k of b, and the derivative of those along a direction. The loops around them are the chain rule: from the
first step to the last along each unit direction of w, from the last to the first with the multipliers. Lanes are
intervals. Neither the number of intervals nor that of steps enters the text.

Written out, the Hessian of one interval of the paper's task has 59 000 instructions, and a compiler takes half a minute
for those of one direction alone; the parts have 7 000.
"""

from __future__ import annotations

import re
import sys

import casadi as ca

from nhpocp.flow.compiled.c_functions import (
    LANES,
    Lanes,
    functions_text,
    identified,
    sizes_text,
    weights_text,
)
from nhpocp.flow.compiled.kernel_cache import NotCompilableError
from nhpocp.flow.shot import Shot

MOST = 40_000  # instructions: beyond, a compiler takes minutes

# sizes are those of the letters in `c_source`; y and b vary from part to part
_WAYS = {
    "value": Lanes("y s c f", "b"),
    "along": Lanes("y s c f dy ds", "db"),
    "back": Lanes("y s c f k", "gy gs"),
    "second": Lanes("y s c f k dy ds dk", "hy hs"),
}

_ALTERNATIVES = re.compile(r"⟨(.*?)\|(.*?)⟩", re.DOTALL)

# ⟨…|…⟩: the points themselves, or how they change along dw, and with them the outputs where there is a place for them
_THERE = r"""
static void ⟨forward(struct block *b)|along(const struct block *b, const double *dw, double *points, double *reached,
                  int lanes, double *const *outputs)⟩ {
  const double *s = b->w + D * L⟨|, *ds = dw + D * L⟩;
  double ⟨*points = b->points, *reached = b->reached, |closed[Q * L], rows[(R + 1) * L], ⟩slopes[S][Y * L];
  opened_⟨value|along⟩(b->w, s, b->c, b->f⟨|, dw, ds⟩, reached);
  for (long long j = 0; j < b->steps; ++j) {
    double *next = REACHED(reached, j + 1), *y = REACHED(reached, j);
    copy(Y, y, next);
    for (int i = 0; i < S; ++i) {
      double *point = STAGE(points, j, i);
      copy(Y, y, point);
      for (int m = 0; m < i; ++m) if (A[i][m] != 0.0) add(Y, A[i][m], slopes[m], point);
      slope_⟨value(point|along(STAGE(b->points, j, i)⟩, s, b->c, SEEN(b, j, PLACE[i])⟨|, point, ds⟩, slopes[i]);
      add(Y, WEIGHT[i], slopes[i], next);
    }
  }⟨|
  if (!outputs) return;
  for (long long j = 0; j <= b->steps; ++j) if (kept(b, j)) {
    rows_along(REACHED(b->reached, j), s, b->c, SEEN(b, j, 0), REACHED(reached, j), ds, rows);
    scatter(b, j, rows, lanes, outputs);
  }
  closed_along(REACHED(b->reached, b->steps), s, b->c, SEEN(b, b->steps, 0), REACHED(reached, b->steps), ds, closed);
  for (int i = 1; i < Q; ++i) for (int l = 0; l < lanes; ++l) outputs[l][i - 1] = closed[i * L + l];⟩
}
"""

# ⟨…|…⟩: g = the derivative of sigma q + lambda outputs by w, with the multipliers of everything, or how g changes
# along dw, whose effect on the points is given
_BACK = r"""
static void ⟨back(struct block *b, const double *const *lambda,|second(struct block *b, const double *const *lambda,
                   const double *dw, const double *points, const double *reached,⟩ double *g) {
  const double *s = b->w + D * L⟨|, *ds = dw + D * L⟩;
  double gy[S][Y * L], gs[(V + 1) * L], y[Y * L], before[Y * L]⟨|, k[Y * L], none[(Q + R) * L]⟩;
  zero(W, g);⟨|
  zero(Q + R, none);⟩
  closed_⟨back|second⟩(REACHED(b->reached, b->steps), s, b->c, SEEN(b, b->steps, 0), b->closed,
                ⟨|REACHED(reached, b->steps), ds, none, ⟩y, gs);
  add(V, 1.0, gs, g + D * L);
  for (long long j = b->steps; j >= 0; --j) {
    if (kept(b, j)) {
      weigh(b, j, lambda);
      rows_⟨back|second⟩(REACHED(b->reached, j), s, b->c, SEEN(b, j, 0), b->rows,
                  ⟨|REACHED(reached, j), ds, none, ⟩before, gs);
      add(Y, 1.0, before, y);
      add(V, 1.0, gs, g + D * L);
    }
    if (!j) break;
    copy(Y, y, before);
    for (int i = S - 1; i >= 0; --i) {⟨
      double *k = STAGE(b->k, j - 1, i);|⟩
      zero(Y, k);
      add(Y, WEIGHT[i], y, k);
      for (int m = i + 1; m < S; ++m) if (A[m][i] != 0.0) add(Y, A[m][i], gy[m], k);
      slope_⟨back|second⟩(STAGE(b->points, j - 1, i), s, b->c, SEEN(b, j - 1, PLACE[i]),
                   ⟨|STAGE(b->k, j - 1, i), STAGE(points, j - 1, i), ds, ⟩k, gy[i], gs);
      add(Y, 1.0, gy[i], before);
      add(V, 1.0, gs, g + D * L);
    }
    copy(Y, before, y);
  }⟨
  copy(Y, y, b->opened);|⟩
  opened_⟨back|second⟩(b->w, s, b->c, b->f, ⟨|b->opened, dw, ds, ⟩y, gy[0], gs);
  add(D, 1.0, gy[0], g);
  add(V, 1.0, gs, g + D * L);
}
"""

_MEMORY = r"""
enum { W = D + V };

static void add(long long size, double factor, const double *restrict a, double *restrict to) {
  for (long long j = 0; j < size * L; ++j) to[j] += factor * a[j];
}
static void copy(long long size, const double *restrict a, double *restrict to) {
  for (long long j = 0; j < size * L; ++j) to[j] = a[j];
}
static void zero(long long size, double *to) {
  for (long long j = 0; j < size * L; ++j) to[j] = 0.0;
}

/* What L intervals know of themselves. Points: the stages of each step, then where steps begin and the last ends. */
struct block {
  long long steps;
  const long long *places;                       /* (steps + 1) x R, or -1 */
  double w[(W + 1) * L], c[(C + 1) * L], *f;     /* f: what the steps see, each B */
  double *points, *reached, *k;                  /* of the stages; k: their multipliers */
  double rows[(R + 1) * L], closed[Q * L], opened[Y * L]; /* multipliers of the last row, of the end, of y_0 */
};
#define STAGE(a, j, i) ((a) + ((S * (j) + (i)) * Y) * L)
#define REACHED(a, j) ((a) + ((j) * Y) * L)
#define SEEN(b, j, place) ((b)->f + (((K - 1) * (j) + (place)) * B) * L)

static int kept(const struct block *b, long long j) {
  for (int i = 0; i < R; ++i) if (b->places[j * R + i] >= 0) return 1;
  return 0;
}

/* the multipliers of the rows after step j; 0 where a row is not kept. lambda: L columns of `outputs` */
static void weigh(struct block *b, long long j, const double *const *lambda) {
  for (int i = 0; i < R; ++i) {
    const long long place = b->places[j * R + i];
    for (int l = 0; l < L; ++l) b->rows[i * L + l] = place < 0 || !lambda[l] ? 0.0 : lambda[l][place];
  }
}

static void scatter(const struct block *b, long long j, const double *values, int lanes, double *const *to) {
  for (int i = 0; i < R; ++i) {
    const long long place = b->places[j * R + i];
    if (place >= 0) for (int l = 0; l < lanes; ++l) to[l][place] = values[i * L + l];
  }
}
"""

_LOOPS = r"""
static void values(const struct block *b, int lanes, double *const *q, double *const *outputs) {
  const double *s = b->w + D * L;
  double closed[Q * L], rows[(R + 1) * L];
  closed_value(REACHED(b->reached, b->steps), s, b->c, SEEN(b, b->steps, 0), closed);
  for (int l = 0; l < lanes; ++l) {
    if (q[l]) *q[l] = closed[l];
    if (outputs[l]) for (int i = 1; i < Q; ++i) outputs[l][i - 1] = closed[i * L + l];
  }
  if (outputs[0]) for (long long j = 0; j <= b->steps; ++j) if (kept(b, j)) {
    rows_value(REACHED(b->reached, j), s, b->c, SEEN(b, j, 0), rows);
    scatter(b, j, rows, lanes, outputs);
  }
}

CASADI_SYMBOL_EXPORT long long nhpocp_shots_work(long long steps) {
  return L * (((K - 1) * steps + 1) * B + 3 * S * steps * Y + 2 * (steps + 1) * Y);
}

/* Columns, one for each of N intervals: w, p, sigma, lambda; q, outputs, the gradient of sigma q + lambda outputs, the
   outputs' Jacobian (outputs x W), the Hessian of the same sum (W x W). Results at 0 are not wanted, and lambda at 0 is
   no multipliers. places: (steps + 1) x R; work: as many doubles as `nhpocp_shots_work` says. */
CASADI_SYMBOL_EXPORT void nhpocp_shots(long long N, long long steps, long long size, const long long *places,
                                       const double *w, const double *p, const double *sigma, const double *lambda,
                                       double *q, double *outputs, double *gradient, double *jacobian,
                                       double *hessian, double *work) {
  const long long parameters = C + ((K - 1) * steps + 1) * B;
  struct block block, *b = &block;
  b->steps = steps;
  b->places = places;
  b->f = work;
  b->points = b->f + ((K - 1) * steps + 1) * B * L;
  b->k = b->points + S * steps * Y * L;
  b->reached = b->k + S * steps * Y * L;
  double *points = b->reached + (steps + 1) * Y * L, *reached = points + S * steps * Y * L;
  for (long long first = 0; first < N; first += L) {
    const int lanes = N - first < L ? (int)(N - first) : L;
    double g[(W + 1) * L], dw[(W + 1) * L], *to_q[L], *to[L];
    const double *multipliers[L];
    for (int l = 0; l < L; ++l) {
      const long long k = first + (l < lanes ? l : 0);
      for (int j = 0; j < W; ++j) b->w[j * L + l] = w[k * W + j];
      for (int j = 0; j < C; ++j) b->c[j * L + l] = p[k * parameters + j];
      for (long long j = C; j < parameters; ++j) b->f[(j - C) * L + l] = p[k * parameters + j];
      multipliers[l] = lambda ? lambda + k * size : 0;
      to_q[l] = q ? q + k : 0;
      to[l] = outputs ? outputs + k * size : 0;
      b->closed[l] = sigma ? sigma[k] : 1.0;
      for (int i = 1; i < Q; ++i) b->closed[i * L + l] = lambda ? multipliers[l][i - 1] : 0.0;
    }
    forward(b);
    values(b, lanes, to_q, to);
    if (gradient || hessian) back(b, multipliers, g);
    if (gradient) for (int l = 0; l < lanes; ++l)
      for (int j = 0; j < W; ++j) gradient[(first + l) * W + j] = g[j * L + l];
    if (jacobian || hessian) for (int d = 0; d < W; ++d) {
      zero(W, dw);
      for (int l = 0; l < L; ++l) dw[d * L + l] = 1.0;
      if (jacobian) for (int l = 0; l < lanes; ++l) to[l] = jacobian + ((first + l) * W + d) * size;
      along(b, dw, points, reached, lanes, jacobian ? to : 0);
      if (!hessian) continue;
      second(b, multipliers, dw, points, reached, g);
      for (int l = 0; l < lanes; ++l)
        for (int j = 0; j < W; ++j) hessian[((first + l) * W + d) * W + j] = g[j * L + l];
    }
  }
}
"""


def identity(shot: Shot) -> str:
    """All that the C text depends on."""
    return identified(shot.parts, shot.tableau, sys.modules[__name__])


def c_source(shot: Shot) -> str:
    """The C text of `nhpocp_shots` for the parts of an interval.

    Errors: `NotCompilableError` where CasADi's code is more than straight lines, or too long.
    """
    functions = {
        f"{name}_{way}": (function, _WAYS[way])
        for part, name in zip(shot.parts, ("opened", "slope", "rows", "closed"), strict=True)
        for way, function in _ways(name, part).items()
    }
    if sum(function.n_instructions() for function, _ in functions.values()) > MOST:
        raise NotCompilableError("the equations of an interval are too long for a compiler")
    head, texts = functions_text(functions)
    sizes = sizes_text(
        shot.tableau,
        D=shot.opened.numel_in(0),
        Y=shot.slope.numel_in(0),
        V=shot.slope.numel_in(1),
        C=shot.slope.numel_in(2),
        B=shot.slope.numel_in(3),
        R=shot.rows.numel_out(0),
        Q=shot.closed.numel_out(0),
        L=LANES,
    )
    walks = [
        _ALTERNATIVES.sub(rf"\{which}", text)
        for which, text in ((1, _THERE), (2, _THERE), (1, _BACK), (2, _BACK))
    ]
    return "".join([head, sizes, weights_text(shot.tableau), texts, _MEMORY, *walks, _LOOPS])


def _ways(name: str, part: ca.Function) -> dict[str, ca.Function]:
    """A part and its derivatives, by the names of `_WAYS`."""
    y, s, c, f = (ca.SX.sym(letter, part.size1_in(i)) for i, letter in enumerate("yscf"))
    dy, ds = ca.SX.sym("dy", y.numel()), ca.SX.sym("ds", s.numel())
    b = part(y, s, c, f)
    k, dk = ca.SX.sym("k", b.numel()), ca.SX.sym("dk", b.numel())
    x, dx = ca.vertcat(y, s), ca.vertcat(dy, ds)
    g = ca.gradient(ca.dot(k, b), x)
    h = ca.jtimes(g, x, dx) + ca.jtimes(g, k, dk)
    results = {
        "value": ([y, s, c, f], [b]),
        "along": ([y, s, c, f, dy, ds], [ca.jtimes(b, x, dx)]),
        "back": ([y, s, c, f, k], ca.vertsplit(g, [0, y.numel(), x.numel()])),
        "second": ([y, s, c, f, k, dy, ds, dk], ca.vertsplit(h, [0, y.numel(), x.numel()])),
    }
    return {
        way: ca.Function(f"{name}_{way}", inputs, ca.cse([ca.densify(value) for value in values]))
        for way, (inputs, values) in results.items()
    }
