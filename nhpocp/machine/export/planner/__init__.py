"""A planner without Python: the trust-region continuation of one problem as a C99 file and its header.

Begin with `c_planner.write_planner`; `parts` says what a problem has to be and makes its functions and numbers, and
the texts around them are `header_text`, `algebra_text`, `path_text` and `loop_text`.
"""
