"""The Jacobian (endogenous configuration space) method, [Paper] eqs. (16)-(17).

Begin with `continuation`, the loop: `step_rules` and `generalized_inverses` say how it steps, `stop_criteria` when it
stops. `auto` tries several ways, `multi_start` several starts, `lockstep` many goals by the loop's own formulas;
`confirmation` integrates claims again.
"""
