"""What may be said of routes in a file and in Python; whoever reads this imports nothing heavy."""

ROUTES = ("auto", "always", "never")
ROUTE = "whether step_rule auto makes manoeuvres along a route of poses: after its quick ways, before them, or not"
ROUTE_SECONDS = "processor time [s] for which a route is looked for, at most"
