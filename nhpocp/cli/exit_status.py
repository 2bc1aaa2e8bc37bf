"""How a call of the program ends, in one number."""

SOLVED = 0  # and verified; whatever else was asked is done
NOT_SOLVED = 1  # everything is still written
BAD_INPUT = 2
MISSING_PART = 3  # an optional one, that `pip install` brings
