"""The Jacobian (endogenous configuration space) method, [Paper] eqs. (16)-(17).

Begin with `continuation`, the loop; its parts are `step_rules`, `generalized_inverses` and `evaluation`. `auto` tries
several ways, `multi_start` several starts, `lockstep` many goals at once; `confirmation` integrates claims again.
"""
