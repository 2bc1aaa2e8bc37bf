"""Laws of `nhpocp/problem_file/`."""
