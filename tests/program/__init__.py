"""The program as a whole: the house, its documents, stops, faults, streams, and laws over families."""
