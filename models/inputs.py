"""Types of declared fields for type checkers: of the constructor's argument and of the attribute."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Generic, Protocol, TypeAlias, TypeVar, overload

import numpy as np
from numpy.typing import NDArray

__all__ = ["Field", "FloatArray", "FloatsOrNone", "Names", "Numbers"]

InputT = TypeVar("InputT", contravariant=True)
ValueT = TypeVar("ValueT", covariant=True)


class Field(Generic[InputT, ValueT]):
    """Annotation of a field: the type that the constructor accepts, and the type of the attribute.

    The field of an array is ``Field[Numbers, Floats]``: the constructor accepts nested lists, and the
    attribute is an array. Type checkers read both from the methods of a descriptor, which exist for
    them alone. Annotations are not evaluated at run time.
    """

    if TYPE_CHECKING:

        @overload
        def __get__(self, instance: None, owner: type) -> Field[InputT, ValueT]: ...
        @overload
        def __get__(self, instance: object, owner: type) -> ValueT: ...
        def __get__(self, instance: object, owner: type) -> Any: ...
        def __set__(self, instance: object, value: InputT) -> None: ...


class _HasArray(Protocol):
    def __array__(self) -> NDArray[Any]: ...


_Entry: TypeAlias = float | _HasArray | None
#: Argument that becomes an array: a number, an array, or lists nested to a depth of three, with None
#: for infinity. ``numpy.typing.ArrayLike`` also accepts strings, which crosstrack rejects.
Numbers: TypeAlias = float | _HasArray | Sequence[_Entry | Sequence[_Entry | Sequence[_Entry]]]
#: Field that contains an array of floats, and one that may be None.
FloatArray: TypeAlias = Field[Numbers, NDArray[np.float64]]
FloatsOrNone: TypeAlias = Field[Numbers | None, NDArray[np.float64] | None]
#: Field that contains the names of rows, or None.
Names: TypeAlias = Field[Sequence[int | str] | None, tuple[int | str, ...] | None]
