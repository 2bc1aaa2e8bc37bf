"""The study of a unicycle that scripts and tests complete: its solvers, its axes."""

CORNERS = """\
nhpocp: 1
study:
  name: corners
  problem:
    system: {model: unicycle}
    start: {x: 0, y: 0, theta: 0}
    goal: {x: 1, y: 1, theta: 0}
"""
