"""`help` of every public name reads as a manual: a summary, every parameter, shapes, units, and what is raised."""

import inspect
import re
from enum import Enum

import pytest

import nhpocp
from nhpocp import testing
from nhpocp.systems.system import Parameter

OBJECTS = {name: getattr(home, name) for home in (nhpocp, testing) for name in home.__all__}
DOCUMENTED = {
    name: value for name, value in OBJECTS.items() if inspect.isclass(value) or inspect.isfunction(value)
}
CALLED = {
    name: [
        p
        for p in inspect.signature(value).parameters.values()
        if p.kind not in (p.VAR_KEYWORD, p.VAR_POSITIONAL)
    ]
    for name, value in DOCUMENTED.items()
    if not (inspect.isclass(value) and issubclass(value, Exception | Enum))
    and not getattr(value, "_is_protocol", False)
}

# handed back by this package, or named for it to make: nobody calls them
HANDED_BACK = {
    "Analysis",
    "Calibration",
    "Comparison",
    "Entry",
    "Motion",
    "Steered",
    "Plan",
    "Solution",
    "Verdict",
}
NAMED = {"DifferentiatedEndPointMap", "SingleShooting", "StagedTranscription", "VariationalEndPointMap"}


def test_what_is_no_function_or_class_is_a_number_or_a_text():
    assert {name for name in OBJECTS if name not in DOCUMENTED} == {"__version__", "deg"}


@pytest.mark.parametrize("name", DOCUMENTED)
def test_it_begins_with_a_sentence_of_its_own(name):
    text = (
        vars(DOCUMENTED[name]).get("__doc__")
        if inspect.isclass(DOCUMENTED[name])
        else DOCUMENTED[name].__doc__
    )
    first, *rest = inspect.cleandoc(text or "").split("\n\n")[0].splitlines()
    assert re.match(r"[A-ZΑ-Ωa-z|∫λφδ(∂].*", first), text
    assert re.search(r"[.:]( |$)", " ".join([first, *rest])), first
    assert not first.startswith("The same")


@pytest.mark.parametrize("name", [name for name, parameters in CALLED.items() if parameters])
def test_it_explains_every_parameter_and_what_it_raises(name):
    text = inspect.getdoc(DOCUMENTED[name])
    missing = [
        p.name
        for p in CALLED[name]
        if not re.search(rf"(\b{p.name}|\*\*{p.name})\b(``|`)?( \(.*\))?(:|,)", text)
    ]
    assert name in NAMED or not missing
    assert name not in NAMED or "To be named, as in " in text
    assert name in HANDED_BACK | NAMED or re.search(r"Errors:\s|Raises nothing", text), "what does it raise?"


@pytest.mark.parametrize("name", [name for name in CALLED if name not in NAMED])
def test_arrays_have_a_shape_and_quantities_a_unit(name):
    text, annotations = inspect.getdoc(DOCUMENTED[name]), [str(p.annotation) for p in CALLED[name]]
    if any("Array" in each for each in annotations):
        assert re.search(r"\((\w+|…),( \w+)*\)|\w+ × \w+|any shape", text)
    if re.search(r"\b(horizon|duration|radius|lengths?|time)\b", " ".join(p.name for p in CALLED[name])):
        assert re.search(r"\[(length|time|rad)\b", text)
    declared = getattr(DOCUMENTED[name], "declared", {})
    for parameter in declared.values() if isinstance(declared, dict) else ():
        assert isinstance(parameter, Parameter)
        assert parameter.described in text
