"""Laws of `nhpocp/solution_folder/`."""
