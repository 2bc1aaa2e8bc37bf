"""An experimental solver, chosen by its name: in a file, on the command line, as a variant."""

import nhpocp
from nhpocp.outcome import Outcome
from nhpocp.problem_file import dump_problem, parse_problem
from nhpocp.problem_file.variants import variant
from nhpocp.solution_folder import load_solution, save_solution
from tests.conftest import paper_problem


def test_it_reaches_the_papers_goal_and_is_verified_and_stored(tmp_path):
    text = dump_problem(paper_problem(pictures=False)) + "solvers: {least_squares: {tolerance: 1e-4}}\n"
    problem = parse_problem(text)
    solution = nhpocp.solve(problem, problem.solvers["least_squares"])
    assert solution.converged
    assert solution.verdict.error < 1e-4
    save_solution(solution, tmp_path / "plan")
    again = load_solution(tmp_path / "plan")
    assert (again.solver, again.settings) == ("least_squares", solution.settings)


def test_a_variant_of_it_may_end_at_its_limit():
    problem, solver = variant(paper_problem(pictures=False), "least_squares:max_iterations=2")
    assert nhpocp.solve(problem, solver).outcome is Outcome.ITERATION_LIMIT
