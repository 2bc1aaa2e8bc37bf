"""The bases by name: the file's choices, their settings and whatever is read back follow from these lines."""

from __future__ import annotations

from nhpocp.controls.basis import ControlBasis
from nhpocp.family import Family, Group

BASES: Family[type[ControlBasis]] = Family(
    {
        "fourier": "nhpocp.controls.fourier:Fourier",
        "legendre": "nhpocp.controls.legendre:Legendre",
        "chebyshev": "nhpocp.controls.chebyshev:Chebyshev",
        "bspline": "nhpocp.controls.bspline:BSpline",
        "piecewise_constant": "nhpocp.controls.piecewise_constant:PiecewiseConstant",
    },
    group=Group("nhpocp.bases", "nhpocp.controls.basis:ControlBasis", "kind", "a basis", ("sequence",)),
)
