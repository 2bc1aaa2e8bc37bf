"""The solvers by name: settings in a file, choices of the command line and variants follow from these lines."""

from __future__ import annotations

from nhpocp.family import Family
from nhpocp.solvers.settings import SolverSettings

SOLVERS: Family[type[SolverSettings]] = Family(
    {
        "jacobian": "nhpocp.solvers.continuation.settings:JacobianSettings",
        "nlp": "nhpocp.solvers.nlp.settings:NlpSettings",
        "least_squares": "nhpocp.solvers.least_squares:LeastSquaresSettings",
        "sinusoids": "nhpocp.solvers.sinusoids:SinusoidsSettings",
    }
)
