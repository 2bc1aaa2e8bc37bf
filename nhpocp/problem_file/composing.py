"""YAML text as ruamel's nodes, within limits; and nodes as plain data that knows where everything in it stands.

Nothing is constructed: so limits hold before anything is expanded, YAML 1.2's core schema decides what is a number, and
no tag can call a class. Nodes keep comments and quotes where they are asked for, so that a changed file can be written.
"""

from __future__ import annotations

import copy
import re
from collections.abc import Iterator
from contextlib import contextmanager
from io import StringIO
from typing import Any, NamedTuple

from ruamel.yaml import YAML
from ruamel.yaml.composer import Composer, ComposerError
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.events import AliasEvent, MappingStartEvent, ScalarEvent
from ruamel.yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode
from ruamel.yaml.resolver import VersionedResolver
from ruamel.yaml.tag import Tag

from nhpocp.errors import InvalidProblemError

LARGEST_TREE = 50_000  # keys and values, aliases expanded: two seconds
DEEPEST = 50  # levels

_INTEGER = re.compile(r"[-+]?[0-9]+")
_BASED = re.compile(r"0x[0-9a-fA-F]+|0o[0-7]+")
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_INFINITE = re.compile(r"[-+]?\.(inf|Inf|INF)")
_WORDS: dict[str, Any] = {
    **dict.fromkeys(("", "~", "null", "Null", "NULL")),
    **dict.fromkeys(("true", "True", "TRUE"), True),
    **dict.fromkeys(("false", "False", "FALSE"), False),
    **dict.fromkeys((".nan", ".NaN", ".NAN"), float("nan")),
}
_CORE = "tag:yaml.org,2002:"
_TOO_MUCH = f"expands to more than {LARGEST_TREE} keys and values; expected a short problem"
_TOO_DEEP = f"nested deeper than {DEEPEST} levels; a problem needs about 6"


class Mark(NamedTuple):
    """Where something stands in the text, counted from 1."""

    line: int
    column: int


def _refusal(message: str, mark: Any, path: str | None = None) -> InvalidProblemError:
    """``mark``: ruamel's, or None where something stands in no text."""
    here = _mark(mark)
    line, column = (here.line, here.column) if here else (None, None)
    return InvalidProblemError(message, path=path, line=line, column=column)


def _mark(mark: Any) -> Mark | None:
    return Mark(mark.line + 1, mark.column + 1) if mark else None


class _Bounded(Composer):
    """Refuses what is too deep or too much while it is read; an alias is a copy that stands where it is used."""

    def __init__(self, loader: Any = None) -> None:
        super().__init__(loader)
        self.warn_double_anchors = False
        self.level = self.count = 0
        self.aliases: set[int] = set()  # ids of those copies

    def compose_node(self, parent: Any, index: Any) -> Any:
        event = self.parser.peek_event()
        self.count += 1
        if self.count > LARGEST_TREE:
            raise _refusal(_TOO_MUCH, event.start_mark)
        if isinstance(event, AliasEvent):
            if event.anchor not in self.anchors:
                raise _refusal(f"no anchor &{event.anchor} stands before this alias", event.start_mark)
            return self._alias(event, super().compose_node(parent, index))
        tag = _explicit_tag(event)
        if isinstance(event, ScalarEvent):
            node = super().compose_node(parent, index)
            if tag in ("str", "!") and not node.style:
                node.style = "'"  # says the same
            return node
        self.level += 1
        if self.level > DEEPEST:
            raise _refusal(_TOO_DEEP, event.start_mark)
        node = super().compose_node(parent, index)
        self.level -= 1
        return node

    def _alias(self, event: Any, node: Any) -> Any:
        if node.end_mark is None:  # not yet closed
            raise _refusal(f"the alias *{event.anchor} contains itself", event.start_mark)
        twin = copy.copy(node)
        twin.start_mark, twin.anchor, twin.comment = event.start_mark, None, event.comment
        self.aliases.add(id(twin))
        return twin


class _Unresolved(VersionedResolver):
    """Leaves unquoted scalars to `resolve`: ruamel would try its own patterns on each of them."""

    @property
    def versioned_resolver(self) -> Any:
        return {}


def _explicit_tag(event: Any) -> str | None:
    """A tag as it is written, if it is one of the core schema's for this kind of node."""
    tag = str(event.tag) if event.tag else None
    if tag is None or tag == "!":
        return tag
    mapping = isinstance(event, MappingStartEvent)
    names = "str int float bool null" if isinstance(event, ScalarEvent) else "map" if mapping else "seq"
    name = tag.removeprefix(_CORE)
    if name == tag or name not in names.split():
        raise _refusal(f"the tag {tag.replace(_CORE, '!!')} means nothing here; remove it", event.start_mark)
    return name


@contextmanager
def _naming(file: str | None) -> Iterator[None]:
    """Puts the file's name into what is refused."""
    try:
        yield
    except InvalidProblemError as error:
        error.file = file
        raise


class Tree:
    """The nodes of one YAML document; with ``comments`` it can be written again. ``file``: how messages call it.

    Errors: `InvalidProblemError` with line and column.
    """

    def __init__(self, text: str, file: str | None = None, comments: bool = False) -> None:
        self._file, self._yaml = file, YAML(typ="rt" if comments else "safe", pure=True)
        self._yaml.Composer = _Bounded
        if not comments:  # what is written needs the tags
            self._yaml.Resolver = _Unresolved
        self._yaml.preserve_quotes, self._yaml.width = True, 4096
        self._yaml.indent(mapping=2, sequence=4, offset=2)
        with _naming(file):
            self.root: Any = self._compose(text)
            self.aliases: set[int] = self._yaml.composer.aliases
            if self.root is None or nothing(self.root):
                words = "the file is empty; expected a problem such as `nhpocp init` writes"
                raise InvalidProblemError(words, line=1, column=1)

    def _compose(self, text: str) -> Any:
        try:
            return self._yaml.compose(text)
        except InvalidProblemError:
            raise
        except MarkedYAMLError as error:
            raise _refusal(_syntax(text, error), error.problem_mark or error.context_mark) from None
        except (YAMLError, ValueError, ArithmeticError, LookupError, TypeError, AttributeError) as error:
            # the scanner's own slips on odd input, such as "\UFFFFFFFF"
            raise InvalidProblemError(f"this is not YAML ({type(error).__name__})") from None

    def plain(self) -> tuple[Any, dict[str, tuple[Mark | None, Mark]]]:
        """Plain data, and the marks of keys and values by dotted paths; what stands in no text has none."""
        reading = _Plain(self.aliases)
        with _naming(self._file):
            return reading.value(self.root, "", None, 1, None), reading.marks

    def unshare(self) -> None:
        """Makes every alias a copy: a change in one place must not show in another."""
        if self.aliases:
            self.plain()  # keeps the limits
            self.root = unshared(self.root)

    def write(self) -> str:
        """The text of the tree."""
        stream = StringIO()
        self._yaml.serialize(self.root, stream)
        return stream.getvalue()


def unshared(node: Node, marked: bool = True) -> Any:
    """A copy of a node and of all that is in it, without anchors; not ``marked``: it stands in no text."""
    twin = copy.copy(node)
    twin.anchor, twin.start_mark = None, node.start_mark if marked else None
    if isinstance(node, MappingNode):
        twin.value = [tuple(unshared(part, marked) for part in pair) for pair in node.value]
    elif isinstance(node, SequenceNode):
        twin.value = [unshared(part, marked) for part in node.value]
    return twin


def scalar(text: str) -> Any:
    """A new node of a text as it stands, a name or nothing."""
    return ScalarNode(Tag(suffix=f"{_CORE}{'str' if text else 'null'}"), text)


def mapping(instead: Any) -> Any:
    """A new node without keys; in one line where what stood there has a comment, which then stays behind it."""
    return MappingNode(Tag(suffix=f"{_CORE}map"), [], flow_style=bool(instead.comment) or None)


def nothing(node: Any) -> bool:
    """Whether a node says null."""
    return isinstance(node, ScalarNode) and _scalar(node) is None


class _Plain:
    """Nodes made into plain data, aliases expanded."""

    def __init__(self, aliases: set[int]) -> None:
        self.marks: dict[str, tuple[Mark | None, Mark]] = {}
        self._aliases, self._count = aliases, 0

    def value(self, node: Any, path: str, key: Any, level: int, alias: Any) -> Any:
        """The data of a node at a dotted path; ``key``, ``alias``: marks of its key, of the alias that it is in."""
        mark = node.start_mark
        alias = alias or (mark if id(node) in self._aliases else None)
        self._count += 1 + (key is not None)
        if self._count > LARGEST_TREE:
            raise _refusal(_TOO_MUCH, alias or mark)
        if level > DEEPEST and not isinstance(node, ScalarNode):
            raise _refusal(_TOO_DEEP, alias or mark)
        if isinstance(node, ScalarNode) and not node.value and not node.style and key:
            mark = key  # nothing stands nowhere: point at its key
        if (here := _mark(mark)) is not None:
            self.marks[path] = (_mark(key), here)
        if isinstance(node, ScalarNode):
            return _scalar(node)
        if isinstance(node, SequenceNode):
            parts = enumerate(node.value)
            return [self.value(part, f"{path}[{i}]", None, level + 1, alias) for i, part in parts]
        return self._mapping(node, f"{path}." if path else "", level, alias)

    def _mapping(self, node: Any, before: str, level: int, alias: Any) -> dict[str, Any]:
        data: dict[str, Any] = {}
        first: dict[str, Any] = {}
        for key, value in node.value:
            if not isinstance(key, ScalarNode):
                kind = "mapping" if isinstance(key, MappingNode) else "list"
                raise _refusal(f"a {kind} as a key; expected a name", key.start_mark)
            name, path = key.value, f"{before}{key.value}"
            if name in first:
                place = _mark(first[name])
                words = f"duplicate key; first given in line {place.line}" if place else "duplicate key"
                raise _refusal(words, key.start_mark, path)
            _scalar(key)
            first[name] = key.start_mark
            data[name] = self.value(value, path, key.start_mark, level + 1, alias)
        return data


def _scalar(node: Any) -> Any:
    if any("\ud800" <= character <= "\udfff" for character in node.value):
        raise _refusal("half of a surrogate pair; expected a whole character", node.start_mark)
    return node.value if node.style and str(node.tag) == f"{_CORE}str" else resolve(node.value)


def resolve(text: str) -> Any:
    """What an unquoted scalar means by YAML 1.2's core schema."""
    if text in _WORDS:
        return _WORDS[text]
    if _INTEGER.fullmatch(text):
        return int(text) if len(text) < 300 else float(text)
    if _BASED.fullmatch(text):
        return int(text, 0)
    if _FLOAT.fullmatch(text):
        return float(text)
    if _INFINITE.fullmatch(text):
        return float(text.replace(".", ""))
    return text


def _syntax(text: str, error: Any) -> str:
    """ruamel's words in ours."""
    if isinstance(error, ComposerError) and error.problem == "but found another document":
        return "a second document begins here; expected one problem a file"
    mark, lines = error.problem_mark or error.context_mark, text.split("\n")
    here = lines[mark.line] if mark and mark.line < len(lines) else ""
    if "\t" in here[: len(here) - len(here.lstrip())] or "'\\t'" in str(error.problem):
        return "a tab in the indentation; YAML wants spaces"
    problem = " ".join(str(error.problem or error.context or "syntax error").split())
    context = f" {' '.join(str(error.context).split())}" if error.problem and error.context else ""
    return f"this is not YAML: {problem}{context}"
