"""Solutions as folders: written whole or not at all, read back without executing anything they contain.

problem.yaml, solution.json, trajectory.csv, arrays.npz, solver.log, iterations.csv on request, and the pictures.
"""

from nhpocp.solution_folder.environment import environment
from nhpocp.solution_folder.plain_data import plain, to_json
from nhpocp.solution_folder.reading import load_solution
from nhpocp.solution_folder.target import check_target, is_solution_folder, unwritable
from nhpocp.solution_folder.writing import save_solution

__all__ = [
    "check_target",
    "environment",
    "is_solution_folder",
    "load_solution",
    "plain",
    "save_solution",
    "to_json",
    "unwritable",
]
