"""Motions that a control makes: integrators, the end-point map Λ ↦ x(T), its Jacobian, and what a motion costs.

Begin with `end_point_map`; a step is in `tableau`, sweeps over steps and their derivatives in `runge_kutta`, whether
the steps are fine enough in `step_error`. `compiled/` makes the same numbers faster and may be left unread.
"""
