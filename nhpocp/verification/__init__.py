"""The second opinion: re-integrates a Solution by DOP853 and returns a Verdict. Imports neither flow nor solvers."""

from nhpocp.verification.verdicts import verify, verify_many

__all__ = ["verify", "verify_many"]
