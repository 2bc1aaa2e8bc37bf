"""Systems ẋ = f(x) + G(x) u, one file a system, and the joints and legs that parallel robots are made of.

Begin with the contract in `system`; the paper's robot is `three_upu`.
"""
