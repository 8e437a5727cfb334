from collections.abc import Iterable, Iterator, Mapping, Sequence
from os import PathLike
from typing import Any, Literal, Protocol, SupportsIndex, overload

import pyarrow  # type: ignore[import-untyped]

__all__ = [
    "InputError",
    "answer_field",
    "arrow",
    "diagnose",
    "identify",
    "map_in_arrow",
    "measure",
    "predict",
    "read",
    "simulate",
]

class _ArrowField(Protocol):
    def __arrow_c_schema__(self) -> object: ...

class _ArrowArray(Protocol):
    def __arrow_c_array__(self, requested_schema: object | None = None) -> tuple[object, object]: ...
    def __len__(self) -> int: ...

class _ArrowBatch(Protocol):
    def __arrow_c_array__(self, requested_schema: object | None = None) -> tuple[object, object]: ...

class _ArrowStream(Protocol):
    def __arrow_c_stream__(self, requested_schema: object | None = None) -> object: ...

_Arrow = _ArrowBatch | _ArrowStream
_Path = str | PathLike[str]
_Function = Literal["identify", "predict", "diagnose"]
_Plan = Literal["default", "paper", "remounted"]

class InputError(ValueError):
    file: str | None
    row: int | None
    column: str | None
    def __init__(
        self, message: str, file: str | None = None, row: int | None = None, column: str | None = None
    ) -> None: ...

@overload
def identify(campaign: _Path | dict[str, Any], *, head: _Path | None = None) -> dict[str, Any]: ...
@overload
def identify(campaign: _Arrow, *, head: _Path | None = None) -> _ArrowStream: ...
@overload
def predict(
    campaign: _Path | dict[str, Any], vibration: str | None = None, *, head: _Path | None = None
) -> dict[str, Any]: ...
@overload
def predict(campaign: _Arrow, vibration: str | None = None, *, head: _Path | None = None) -> _ArrowStream: ...
@overload
def diagnose(campaign: _Path | dict[str, Any], *, head: _Path | None = None) -> dict[str, Any]: ...
@overload
def diagnose(campaign: _Arrow, *, head: _Path | None = None) -> _ArrowStream: ...
def measure(
    record: _Path | Mapping[str, Iterable[float]] | _Arrow,
    columns: Sequence[str] = ...,
    *,
    units_per_g: float | None = None,
    time: str | None = None,
    temperature: str | None = None,
    before: str | None = None,
    during: str | None = None,
    group: str | None = None,
    without: str | None = None,
    run: int | None = None,
    full_scale_g: float | None = None,
) -> dict[str, Any]: ...
@overload
def simulate(
    out: _Path | None = None,
    *,
    seed: SupportsIndex = 1,
    plan: _Plan = "default",
    dial_sigma_arcsec: float = 1.0,
    effects: Sequence[str] = ...,
    strength: float = 1.0,
    imperfections: Sequence[str] = ...,
    force: bool = False,
) -> dict[str, Any]: ...
@overload
def simulate(
    *,
    seed: Iterable[int],
    plan: _Plan = "default",
    dial_sigma_arcsec: float = 1.0,
    effects: Sequence[str] = ...,
    strength: float = 1.0,
    imperfections: Sequence[str] = ...,
) -> _ArrowBatch: ...
def read(folder: _Path) -> dict[str, Any]: ...
def arrow(campaigns: Iterable[_Path] | Iterable[dict[str, Any]]) -> _ArrowArray: ...
def answer_field(function: _Function = "identify") -> _ArrowField: ...
def map_in_arrow(
    batches: Iterable[pyarrow.RecordBatch],
    function: _Function = "identify",
    vibration: str | None = None,
    head: _Path | None = None,
) -> Iterator[pyarrow.RecordBatch]: ...
