"""Lie brackets, growth vectors, ranks, agility and maps of singularities of a planning problem."""

from nhpocp.analysis.analysis import Analysis, analyze

__all__ = ["Analysis", "analyze"]
