"""Read-only, validated NumPy arrays for immutable value types."""

from collections.abc import Sequence
from typing import Self

import numpy as np
import numpy.typing as npt

from poil_drake.errors import InvalidValueError


def frozen_array(
    value: npt.ArrayLike,
    *,
    name: str,
    shape: Sequence[int | str],
    dtype: npt.DTypeLike = np.float64,
    finite: bool = True,
) -> np.ndarray:
    """Returns `value` as a read-only array of the required shape.

    Args:
        value: Anything that `np.asarray` accepts. It is copied unless it is already a read-only
            array of type `dtype` that owns its data.
        name: Name of the value in errors, such as "CameraModel.K".
        shape: The required shape. An int is an exact size; a str names a free dimension, whose
            size must be the same wherever the name occurs.
        dtype: The element type.
        finite: Whether NaN and infinity are rejected.

    Raises:
        InvalidValueError: if the shape differs or a number is not finite.
    """
    array = np.asarray(value, dtype=dtype)
    sizes: dict[str, int] = {}
    fits = array.ndim == len(shape)
    for size, want in zip(array.shape, shape, strict=False):
        fits = fits and size == (sizes.setdefault(want, size) if isinstance(want, str) else want)
    if not fits:
        raise InvalidValueError(
            f"{name} has shape {array.shape}, but ({', '.join(map(str, shape))}) is needed.",
            remedy="Pass an array of the needed shape.",
        )
    if finite and array.dtype.kind == "f" and not np.all(np.isfinite(array)):
        raise InvalidValueError(
            f"{name} holds {np.count_nonzero(~np.isfinite(array))} values that are not finite.",
            remedy="Replace or leave out NaN and infinite values.",
        )
    if array.flags.writeable or array.base is not None:
        array = array.copy()
        array.flags.writeable = False
    return array


def freeze_fields(
    value: object,
    *,
    dtype: npt.DTypeLike = np.float64,
    finite: bool = True,
    **shapes: Sequence[int | str],
) -> None:
    """Replaces array fields of a frozen dataclass with read-only arrays of the required shapes.

    Call this in `__post_init__`. A named dimension must have the same size in all fields.

    Args:
        value: The instance of the dataclass.
        dtype: The element type of the arrays.
        finite: Whether NaN and infinity are rejected.
        shapes: The required shape of each field, by the field's name; see `frozen_array`.

    Raises:
        InvalidValueError: if a shape differs or a number is not finite.
    """
    sizes: dict[int | str, int] = {}
    for name, shape in shapes.items():
        array = frozen_array(
            getattr(value, name),
            name=f"{type(value).__name__}.{name}",
            shape=[sizes.get(size, size) for size in shape],
            dtype=dtype,
            finite=finite,
        )
        sizes.update(zip(shape, array.shape, strict=True))
        object.__setattr__(value, name, array)


class SharedOnCopy:
    """Mixin for immutable types: `copy.copy` and `copy.deepcopy` return the object itself.

    Drake clones abstract values with `copy.deepcopy`. Immutable values need no clones.
    """

    def __copy__(self) -> Self:
        return self

    def __deepcopy__(self, memo: dict) -> Self:
        return self
