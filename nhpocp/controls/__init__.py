"""Controls u(t) = Λ φ(t) over a basis of functions, one file a basis.

Begin with `control.Control` and the contract in `basis`.
"""
