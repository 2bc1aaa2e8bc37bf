"""Motions that a control makes: integrators, the end-point map Λ ↦ x(T), its Jacobian, and what a motion costs.

Begin with `end_point_map`; the step and its derivative are in `runge_kutta`. `compiled/` makes the same numbers faster
and may be left unread.
"""
