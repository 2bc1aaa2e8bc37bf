"""A plan as a machine takes it: sampled at its rate, in its time, within its limits, in a file that it reads.

Begin with `motion.make_motion`; `time_scaling` says when the motion is where, `limits` how fast it may be, and every
file format is a function of a `Motion`, announced in `registry`.
"""
