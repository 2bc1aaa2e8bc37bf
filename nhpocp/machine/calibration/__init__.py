"""The model fitted to a machine: what is measured of runs, which parameters, how well they are seen.

Begin with `calibration`, which fits. `measurements` is a run, `unknowns` what may be fitted, `leg_driven_steps` the
motion under leg lengths with its derivatives, `smoothing` the least squares of one run in one sweep.
"""
