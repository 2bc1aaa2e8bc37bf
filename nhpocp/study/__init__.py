"""Studies: many runs from one file.

A study file names a problem and axes; a `Design` is the points that they span, a run one of them by one solver. Begin
with `study.py`; `schema.py` is the file's keys, `design.py` the points.
"""
