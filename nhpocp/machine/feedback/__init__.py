"""Feedback by planning again: run a plan, measure, plan the rest from there. [Lucibello & Oriolo 2001]

Begin with `plant`, what a machine has to offer, and `steering`, the cycle. `simulated_plant` is a machine that differs
from its model, `machines` draws many of them.
"""
