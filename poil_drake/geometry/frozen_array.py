"""Read-only, validated NumPy arrays: the stuff of the types that pass between stages."""

from collections.abc import Sequence
from typing import Self

import numpy as np
import numpy.typing as npt

from poil_drake.errors import InvalidValueError


def frozen_array(
    value: npt.ArrayLike,
    *,
    name: str,
    shape: Sequence[int | str | None],
    dtype: npt.DTypeLike = np.float64,
    finite: bool = True,
) -> np.ndarray:
    """Returns `value` as a read-only array after checking its shape.

    Args:
        value: Anything `np.asarray` takes. An array that can still be written to is copied.
        name: What to call the value in an error, e.g. "CameraModel.K".
        shape: The wanted shape. An int is matched exactly; a str names a free dimension (used
            twice, it must agree with itself); None leaves a dimension free.
        dtype: The wanted element type.
        finite: Whether NaN and infinity are refused.

    Raises:
        InvalidValueError: naming the field, the shape wanted and the shape given.
    """
    array = np.asarray(value, dtype=dtype)
    wanted = "(" + ", ".join("*" if s is None else str(s) for s in shape) + ")"
    bound: dict[str, int] = {}
    fits = array.ndim == len(shape)
    for size, want in zip(array.shape, shape, strict=False):
        if isinstance(want, str):
            fits = fits and bound.setdefault(want, size) == size
        elif want is not None:
            fits = fits and size == want
    if not fits:
        raise InvalidValueError(
            f"{name} has shape {array.shape}, but {wanted} is needed.",
            remedy="Pass an array of that shape.",
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


class SharedOnCopy:
    """Mixin for immutable values: a copy is the value itself.

    Drake clones abstract values with `copy.deepcopy`; there is no need to copy what cannot change.
    """

    def __copy__(self) -> Self:
        return self

    def __deepcopy__(self, memo: dict) -> Self:
        return self
