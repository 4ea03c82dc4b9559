"""Which definitions of a dependency are newer than a commit.

A figure is old where the code that it was measured on is another today. Text is not code: comments,
docstrings, messages and the module that a definition stands in may change. Compared are top-level
definitions (functions, classes, assignments and other statements, imports apart) as syntax trees,
and files that are not Python by their content.
"""

import ast
import os
import re
import subprocess
from collections import defaultdict
from collections.abc import Iterator, KeysView, Mapping, Sequence
from functools import cache, cached_property
from itertools import chain
from pathlib import Path
from typing import NamedTuple, TypeAlias

PRODUCT = ("sensors", "pipeline", "tests/outside")
"""Where a definition may have stood before, beside the dependency itself."""
TEXT = "a text"  # stands for each text that people read
BLANK = " "  # a string with one is a text, one without is a key

_Import = (ast.Import, ast.ImportFrom)
_Function: TypeAlias = ast.FunctionDef | ast.AsyncFunctionDef


class Definition(NamedTuple):
    """What a top-level statement defines."""

    kind: str
    name: str

    def __str__(self) -> str:
        return f"{self.kind} {self.name}"


class Repository:
    """The code of a repository, of today (with what is not committed) and of any commit."""

    def __init__(self, root: Path) -> None:
        self._root = root
        self._blobs: dict[tuple[str, str], _File] = {}  # by blob and name of the file
        self._today = cache(self._read)
        self._past = cache(self._at)

    def newer(self, commit: str, depends: Sequence[str]) -> Iterator[str]:
        """Find what a dependency defines today and did not at a commit.

        Parameters
        ----------
        commit : str
            Full identifier.
        depends : sequence of str
            Files and folders, relative to the root.

        Yields
        ------
        str
            As in "pipeline/oma/poles.py: function modes_of_poles". Nothing where there is no
            repository, or the commit is not in it, as in a shallow clone.

        Notes
        -----
        A definition is newer where the same file had another one of that name at the commit, or
        where it stood nowhere in `PRODUCT` and the dependency. One that has left the dependency
        still belongs to it, since those that call it may be the same but for an import. Modules of
        tests (test_*.py) inside a dependency are no part of it: no figure is measured by them. Not
        seen
        are an import that takes a name from another module, where both have one, and a definition
        or file that vanished although nothing calls it by name.
        """
        past = self._past(commit, tuple(dict.fromkeys((*PRODUCT, *depends))))
        inside = [path for path in past.changed if _is_in(path, depends) and not _is_test(path)]
        left: set[Definition] = set()
        for path in inside:
            now, before = self._today(path), past.changed[path]
            for definition in now.definitions:
                if _is_new(definition, now, before, past):
                    yield _told(path, definition)
            left |= before.definitions - now.definitions
        for path, before in past.changed.items() if left else ():
            now = self._today(path)
            came = () if path in inside else left & (now.definitions - before.definitions)
            for definition in sorted(came):
                if _is_new(definition, now, before, past):
                    yield _told(path, definition)

    @cached_property
    def _tracked(self) -> list[str]:
        return _split(_git(self._root, "ls-files", "-z"))

    @cached_property
    def _untracked(self) -> list[str]:
        return _split(_git(self._root, "ls-files", "-z", "--others", "--exclude-standard"))

    def _read(self, path: str) -> "_File":
        file = self._root / path
        return _File(file.name, file.read_bytes() if file.is_file() else None)

    def _at(self, commit: str, places: tuple[str, ...]) -> "_Past":
        """The files of those places at a commit; none where git does not have it."""
        options = ("--raw", "-z", "--no-abbrev", "--no-renames", "--no-ext-diff")
        answer = _git(self._root, "diff", *options, commit, "--", *places)
        if answer is None:
            return _Past({}, [])
        fields = _split(answer)
        # A field ":mode mode blob blob status" before each path; a blob of zeros is none.
        blobs = {
            path: each.split()[2] for each, path in zip(fields[::2], fields[1::2], strict=True)
        }
        for path in self._untracked:
            if _is_in(path, places):
                blobs.setdefault(path, "")
        self._fetch(blobs)
        return _Past(
            {path: self._blobs[blob, Path(path).name] for path, blob in sorted(blobs.items())},
            [
                self._today(path)
                for path in self._tracked
                if path not in blobs and _is_in(path, places)
            ],
        )

    def _fetch(self, blobs: Mapping[str, str]) -> None:
        """Read those blobs, by path, that were not read before.

        One that is not there, as in a partial clone, defines nothing: all of its file is newer.
        """
        wanted = {(blob, Path(path).name) for path, blob in blobs.items()} - self._blobs.keys()
        asked = [each for each in wanted if each[0].strip("0")]
        names = "".join(f"{blob}\n" for blob, _ in asked)
        answer = _git(self._root, "cat-file", "--batch", asked=names.encode()) or b""
        self._blobs |= {each: _File(each[1], None) for each in wanted}
        for each in asked if answer else ():
            header, _, answer = answer.partition(b"\n")
            if not header.endswith(b" missing"):
                size = int(header.split()[2])
                self._blobs[each] = _File(each[1], answer[:size])
                answer = answer[size + 1 :]


class _Past(NamedTuple):
    """The files of the product and of a dependency at a commit."""

    changed: Mapping[str, "_File"]
    """Those that are another today, by path in order."""
    unchanged: Sequence["_File"]


class _File:
    """What a file of some time defines; nothing where it is missing."""

    def __init__(self, name: str, content: bytes | None) -> None:
        self._name = name
        self._content = content or b""
        self._is_missing = content is None
        self._trees: dict[Definition, frozenset[str | bytes]] = {}

    @cached_property
    def definitions(self) -> KeysView[Definition]:
        """All of them, in their order."""
        if self._is_missing:
            return {}.keys()
        if not self._name.endswith(".py"):
            return {Definition("file", self._name): ()}.keys()
        return self._statements.keys()

    def trees(self, definition: Definition) -> frozenset[str | bytes]:
        """The syntax trees of a definition: several where overloads share a name, or none."""
        if definition not in self._trees:
            self._trees[definition] = frozenset(self._made(definition))
        return self._trees[definition]

    def _made(self, definition: Definition) -> Iterator[str | bytes]:
        if definition.kind == "file":
            if definition in self.definitions:
                yield self._content
        elif self._name.endswith(".py"):
            for statement in self._statements.get(definition, ()):
                yield ast.dump(_without_texts(statement))

    def may_have(self, definition: Definition) -> bool:
        """Whether it may define this: a file that lacks the name need not be parsed."""
        if definition.kind in ("file", "statement"):
            return True
        return all(word.encode() in self._content for word in re.findall(r"\w+", definition.name))

    @cached_property
    def _statements(self) -> dict[Definition, list[ast.stmt]]:
        found: dict[Definition, list[ast.stmt]] = defaultdict(list)
        for statement in ast.parse(self._content).body:
            if (definition := _defined(statement)) is not None:
                found[definition].append(statement)
        return dict(found)


def _defined(statement: ast.stmt) -> Definition | None:
    """What a top-level statement defines; None for imports and docstrings."""
    match statement:
        case ast.FunctionDef() | ast.AsyncFunctionDef():
            return Definition("function", statement.name)
        case ast.ClassDef():
            return Definition("class", statement.name)
        case ast.Assign():
            return Definition("assignment", ", ".join(map(ast.unparse, statement.targets)))
        case ast.AnnAssign():
            return Definition("assignment", ast.unparse(statement.target))
        case ast.Import() | ast.ImportFrom() | ast.Expr(value=ast.Constant()):
            return None
        case ast.If(body=body, orelse=[]) if all(isinstance(each, _Import) for each in body):
            return None
    return Definition("statement", ast.unparse(_without_texts(statement)).splitlines()[0])


def _without_texts(statement: ast.stmt) -> ast.stmt:
    """The statement itself, from which texts for people and imports are taken."""
    without: ast.stmt = _Code().visit(statement)
    return without


class _Code(ast.NodeTransformer):
    """Leaves the code of a statement.

    Strings that are compared, looked up or matched, and annotations, are code in any case.
    """

    def visit_Expr(self, node: ast.Expr) -> ast.AST | None:
        """Drop docstrings, those of attributes too."""
        if isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            return None
        return self.generic_visit(node)

    def visit_Import(self, node: ast.Import) -> None:
        """Drop it."""

    def visit_ImportFrom(self, node: ast.ImportFrom) -> None:
        """Drop it."""

    def visit_Constant(self, node: ast.Constant) -> ast.Constant:
        """Blank a text."""
        is_text = isinstance(node.value, str) and BLANK in node.value
        return ast.Constant(TEXT) if is_text else node

    def visit_JoinedStr(self, node: ast.JoinedStr) -> ast.AST:
        """Blank a text with all that it prints."""
        parts = [str(each.value) for each in node.values if isinstance(each, ast.Constant)]
        return ast.Constant(TEXT) if any(BLANK in each for each in parts) else node

    def visit_Compare(self, node: ast.Compare) -> ast.Compare:
        """Keep it."""
        return node

    def visit_MatchValue(self, node: ast.MatchValue) -> ast.MatchValue:
        """Keep it."""
        return node

    def visit_arg(self, node: ast.arg) -> ast.arg:
        """Keep its annotation."""
        return node

    def visit_AnnAssign(self, node: ast.AnnAssign) -> ast.AnnAssign:
        """Keep its annotation."""
        if node.value is not None:
            node.value = self.visit(node.value)
        return node

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.AST:
        """Keep what it returns."""
        return self._with_returns(node)

    def visit_AsyncFunctionDef(self, node: ast.AsyncFunctionDef) -> ast.AST:
        """Keep what it returns."""
        return self._with_returns(node)

    def visit_Subscript(self, node: ast.Subscript) -> ast.Subscript:
        """Keep the key."""
        node.value = self.visit(node.value)
        return node

    def visit_Dict(self, node: ast.Dict) -> ast.Dict:
        """Keep the keys."""
        node.values = [self.visit(each) for each in node.values]
        return node

    def visit_Call(self, node: ast.Call) -> ast.AST:
        """Keep a regular expression."""
        match node.func:
            case ast.Attribute(value=ast.Name(id="re")):
                return node
        return self.generic_visit(node)

    def _with_returns(self, node: _Function) -> ast.AST:
        returns, node.returns = node.returns, None
        self.generic_visit(node)
        node.returns = returns
        return node


def _is_new(definition: Definition, now: _File, before: _File, past: _Past) -> bool:
    """Whether a definition of a file of today stood nowhere; `before` is the file as it was."""
    trees = now.trees(definition)
    if before.trees(definition):
        return not trees <= before.trees(definition)
    return not any(
        trees <= other.trees(definition)
        for other in chain(past.changed.values(), past.unchanged)
        if other.may_have(definition)
    )


def _told(path: str, definition: Definition) -> str:
    return path if definition.kind == "file" else f"{path}: {definition}"


def _is_in(path: str, places: Sequence[str]) -> bool:
    return any(path == place or path.startswith(f"{place}/") for place in places)


def _is_test(path: str) -> bool:
    return Path(path).name.startswith("test_")


def _split(answer: bytes | None) -> list[str]:
    return [os.fsdecode(each) for each in (answer or b"").split(b"\0") if each]


def _git(root: Path, *arguments: str, asked: bytes = b"") -> bytes | None:
    """What git answers; None where there is no repository or no such commit."""
    ran = subprocess.run(
        ["git", *arguments], cwd=root, input=asked, capture_output=True, check=False
    )
    return ran.stdout if ran.returncode == 0 else None
