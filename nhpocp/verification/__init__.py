"""The second opinion: re-integrates a Solution with SciPy and returns a Verdict. Imports neither flow nor solvers."""

from nhpocp.verification.checks import verify

__all__ = ["verify"]
