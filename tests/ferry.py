"""The example of a user's own system in problems/recipes.md, word for word."""

from typing import ClassVar

from nhpocp import Parameter, PlanningProblem, StateSpace, System, namespace, scalar, solve, vector


class Ferry(System):
    """A boat that cannot slip sideways through water that flows along x; its bow may be a goal."""

    model = "ferry"
    declared: ClassVar = {"current": Parameter("number", 0.5, "speed of the water [length/time]")}
    state_space = StateSpace([vector("position", 2, "length"), scalar("theta", "angle")])
    input_space = StateSpace([scalar("v", "length"), scalar("w", "angle")])
    output_blocks = (vector("bow", 2, "length", of_pose=True),)

    def heading(self, state):
        xp = namespace(state)  # NumPy for numbers, CasADi for symbols
        return xp.vector([xp.cos(state[2]), xp.sin(state[2])])

    def vector_fields(self, state):
        ahead = self.heading(state)
        return namespace(state).matrix([[ahead[0], 0], [ahead[1], 0], [0, 1]])

    def drift(self, state):
        return namespace(state).vector([self.current, 0, 0])

    def constraints(self, state, velocity):  # from geometry; only the tests of laws use it
        ahead = self.heading(state)
        through = [velocity[0] - self.current, velocity[1]]
        return namespace(state, velocity).vector([through[0] * ahead[1] - through[1] * ahead[0]])

    def outputs(self, state, control):
        return {"bow": state[:2] + self.heading(state)}


if __name__ == "__main__":
    problem = PlanningProblem(system=Ferry(), start={"position": [0, 0], "theta": 0}, goal={"bow": [0, 2]})
    plan = solve(problem)
    print(plan.outcome.value, plan.trajectory["bow"][-1], plan.costs["effort"])
