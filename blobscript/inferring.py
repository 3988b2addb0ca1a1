"""What the rules for names, records and calls need of the checker that they are a part of.

Checking is one recursion: a call holds expressions, and an expression holds calls. The rules for both are
modules of their own, which see the recursion as `Inferring` and what is known of a file's definitions as
`Known`; `infer` and `check` put them together.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Protocol

from blobscript import syntax, typed
from blobscript.callables import Signature
from blobscript.diagnostics import Diagnostic
from blobscript.resolve import Definition, Module
from blobscript.scopes import Scope
from blobscript.source import Span
from blobscript.types import Type

__all__ = ["Inferring", "Known"]


class Known(Protocol):
    """The definitions of a program, found out about on demand."""

    def report(self, diagnostic: Diagnostic) -> None: ...

    def only_checking(self) -> AbstractContextManager[None]: ...

    def use(self, definition: Definition) -> None: ...

    def value_type(self, definition: Definition, span: Span) -> Type: ...

    def type_if_known(self, definition: Definition) -> Type | None: ...

    def alias(self, definition: Definition) -> Type: ...

    def signature(self, definition: Definition, span: Span) -> Signature: ...

    def is_incomplete(self, definition: Definition) -> bool: ...

    def record_type(self, file: str, module: Module, span: Span, file_span: Span) -> Type: ...


class Inferring(Protocol):
    """The check of the expressions of one file."""

    @property
    def module(self) -> Module: ...

    @property
    def known(self) -> Known: ...

    def report(self, diagnostic: Diagnostic) -> None: ...

    def expr(self, node: syntax.Expr, scope: Scope, expected: Type | None = None) -> typed.Expr: ...

    def block(
        self, node: syntax.Block, scope: Scope, wanted: Type | None, misfit: Callable[[syntax.Expr, Type], Diagnostic]
    ) -> typed.Expr: ...
