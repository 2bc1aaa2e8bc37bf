"""Studies: many runs from one file, stored one row each.

A study file names a problem and axes; a `Design` is the points that they span, a run one of them by one solver. Begin
with `study.py`; `sweep.py` hands runs to processes, round by round, `run.py` performs them there, `store.py` keeps the
rows. Where a study optimises, `optimiser.py` proposes the next round, and `trials.py` says how good the last was.
"""

STORE = "study.sqlite"  # of a study, in its folder
