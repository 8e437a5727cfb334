"""Vibration rectification error of accelerometers: identify, predict, diagnose, measure, simulate.

A campaign is a folder, a dict, or a row of Arrow. A folder and a dict give a dict; Arrow gives Arrow, which everything that speaks
the Arrow C data interface reads: pyarrow, Polars, pandas, DuckDB. Names and units are those of the JSON of the command ``vre``.

>>> import vre
>>> made = vre.simulate(seed=7, plan="remounted")
>>> found = vre.identify(made["campaign"])
>>> k2 = found["coefficients"]["k2_per_g"]
>>> abs(k2["value"] - made["truth"]["coefficients"][3]) < 4 * k2["sigma"]
True
"""

import json
import os

from . import _vre

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


class InputError(ValueError):
    """Bad input. ``file``, ``row`` (the header is row 1) and ``column`` say where, None where that is not known.

    >>> import vre
    >>> campaign = vre.simulate()["campaign"]
    >>> campaign["readings"][3]["u_v"] = "1,2"
    >>> try:
    ...     vre.identify(campaign)
    ... except vre.InputError as error:
    ...     print(error.file, error.row, error.column)
    static.csv 5 u_v
    """

    def __init__(self, message, file=None, row=None, column=None):
        super().__init__(message)
        self.file = file
        self.row = row
        self.column = column

    def __reduce__(self):
        return type(self), (str(self), self.file, self.row, self.column)


def _is_arrow(data):
    return hasattr(data, "__arrow_c_array__") or hasattr(data, "__arrow_c_stream__")


def _whole(column):
    """A column of pyarrow without an offset into its structs, which arrow-rs 59 cannot read of structs within structs. No copy."""
    import pyarrow

    if isinstance(column, pyarrow.ChunkedArray):
        return pyarrow.chunked_array([_whole(chunk) for chunk in column.chunks], column.type)
    if not isinstance(column, pyarrow.StructArray):
        return column
    fields = list(column.type)
    parts = [_whole(column.field(index)) for index in range(len(fields))]
    return pyarrow.StructArray.from_arrays(parts, fields=fields, mask=column.is_null())


def _campaigns(data):
    """The column of campaigns of Arrow."""
    try:
        import pyarrow
    except ImportError:
        return data
    column = pyarrow.chunked_array(data) if hasattr(data, "__arrow_c_stream__") else pyarrow.array(data)
    return _whole(column)


def _text(campaign):
    """A dict as JSON; numbers of NumPy are numbers."""

    def plain(value):
        if hasattr(value, "tolist"):
            return value.tolist()
        raise InputError(f"a {type(value).__name__} is neither a number nor text")

    return json.dumps(campaign, default=plain)


def _ask(name, campaign, vibration=None, head=None):
    head = None if head is None else os.fspath(head)
    if _is_arrow(campaign):
        return _vre.of_arrow(name, _campaigns(campaign), vibration, head)
    if isinstance(campaign, dict):
        return json.loads(_vre.of_dict(name, _text(campaign), vibration, head))
    return json.loads(_vre.of_folder(name, os.fspath(campaign), vibration, head))


def identify(campaign, *, head=None):
    """The coefficients of the IEEE 1293 model from the static readings of a campaign, ``vre-identification/1``.

    ``campaign``: a folder; a dict with ``toml`` (``campaign.toml`` as text), ``readings`` and, if there are any, ``runs`` (lists of
    rows with the columns of ``static.csv`` and ``vibration.csv``), as :func:`read` gives it; or Arrow, as :func:`arrow` gives it: a
    column of campaigns, or record batches with such a column ``campaign``. Of Arrow a campaign that cannot be used has nulls and a
    ``reason``.

    ``head``: a ``head.toml`` with what is known of the dividing head's marks; a campaign that contradicts it is refused.

    >>> import vre
    >>> vre.identify(vre.simulate()["campaign"])["rank"]
    11
    """
    return _ask("identify", campaign, head=head)


def predict(campaign, vibration=None, *, head=None):
    """The vibration error that a campaign predicts, ``vre-prediction/1``: of ``vibration`` along the input axis (``"random:1"`` with
    its rms, ``"sine:5"`` with its peak, in g), else of the campaign's own runs.

    >>> import vre
    >>> campaign = vre.simulate(plan="remounted")["campaign"]
    >>> vre.predict(campaign, "random:1")["runs"][0]["vre_g"]["sigma"] < 3e-5
    True
    """
    return _ask("predict", campaign, vibration, head)


def diagnose(campaign, *, head=None):
    """Whether prediction and shaker part, where, and which effect does it, ``vre-diagnosis/1``. Arrow has of it what a table asks
    for.

    >>> import vre
    >>> made = vre.simulate(seed=7, effects=["fixture-resonance"], strength=3)
    >>> vre.diagnose(made["campaign"])["which"][0]["effects"]
    ['fixture-resonance']
    """
    return _ask("diagnose", campaign, head=head)


def measure(
    record,
    columns=(),
    *,
    units_per_g=None,
    time=None,
    temperature=None,
    before=None,
    during=None,
    group=None,
    without=None,
    run=None,
    full_scale_g=None,
):
    """The shift of the mean output under vibration, with its interval and every other explanation of it, ``vre-measurement/1``.

    ``record``: a file of any format that ``vre measure`` reads, a dict of columns of numbers, or record batches. ``columns`` are the
    outputs, one an axis, and ``units_per_g`` is their scale; a column whose name tells a unit of acceleration, as ``x_g``, needs
    neither. ``time`` and ``temperature`` (degrees Celsius) are columns; the name of the first tells its unit (``t_ms``), else it is
    s. Rests and plateaus are found, or ``before`` and ``during`` are windows ``"0..10"`` in s, or with ``group`` names of a column of
    text. ``full_scale_g``: where the output clips. ``run``: of a record of frames.

    >>> import math, random, vre
    >>> noise = random.Random(1)
    >>> t = [k / 1000 for k in range(40000)]
    >>> moving = [1.0 if 15 <= at < 25 else 0.0 for at in t]
    >>> x = [noise.gauss(0, 1e-3) + m * (0.1 + math.sin(500 * at)) for at, m in zip(t, moving)]
    >>> found = vre.measure({"t_s": t, "x_g": x})
    >>> found["verdict"], round(found["plateaus"][0]["shift_g"]["value"], 2)
    ('shift', 0.1)
    """
    said = {
        "columns": list(columns),
        "units_per_g": units_per_g,
        "time": time,
        "temperature": temperature,
        "before": before,
        "during": during,
        "group": group,
        "without": without,
        "run": run,
        "full_scale_g": full_scale_g,
    }
    if _is_arrow(record):
        return json.loads(_vre.of_batches(record, said))
    if isinstance(record, dict):
        numbers = {}
        for name, values in record.items():
            try:
                numbers[name] = [float(value) for value in values]
            except (TypeError, ValueError) as error:
                raise InputError(f"record, column {name}: {error}", "record", None, name) from None
        return json.loads(_vre.of_columns(numbers, said))
    return json.loads(_vre.of_file(os.fspath(record), said))


def simulate(
    out=None,
    *,
    seed=1,
    plan="default",
    dial_sigma_arcsec=1.0,
    effects=(),
    strength=1.0,
    imperfections=(),
    force=False,
):
    """A campaign of the virtual bench, fixed by its ``seed``.

    With the folder ``out``, as ``vre simulate`` writes it, and the truth behind it is given (``force``: over a campaign that is
    there). Without, a dict of ``campaign``, ``holdout`` (runs to predict) and ``truth``. With many seeds, a record batch with the
    columns ``seed``, ``campaign`` and ``true_k2_per_g``.

    ``plan``: ``default``, ``paper`` or ``remounted``. ``effects``: what the nominal model does not know, ``strength`` times a
    typical one. ``imperfections``: ``"ID"`` or ``"ID:SIZE"``, as ``vre simulate --help`` lists them.

    >>> import vre
    >>> vre.simulate(seed=3)["truth"]["serial"]
    'V00003'
    >>> import pyarrow
    >>> pyarrow.record_batch(vre.simulate(seed=range(2))).num_rows
    2
    """
    wanted = {
        "plan": plan,
        "dial_sigma_arcsec": dial_sigma_arcsec,
        "effects": list(effects),
        "strength": strength,
        "imperfections": list(imperfections),
    }
    many = not hasattr(seed, "__index__")
    if many and out is not None:
        raise InputError("a folder takes one campaign; write many with one seed each")
    if many:
        return _vre.to_arrow(list(seed), wanted)
    if out is None:
        return json.loads(_vre.to_dict(seed, wanted))
    return json.loads(_vre.to_folder(os.fspath(out), seed, wanted, force))


def read(folder):
    """A campaign folder as a dict.

    >>> import tempfile, vre
    >>> folder = tempfile.mkdtemp()
    >>> _ = vre.simulate(folder)
    >>> len(vre.read(folder)["readings"])
    80
    """
    return json.loads(_vre.read(os.fspath(folder)))


def arrow(campaigns):
    """Campaigns, folders or dicts, as an Arrow column of structs.

    >>> import vre
    >>> len(vre.arrow([vre.simulate(seed=seed)["campaign"] for seed in range(3)]))
    3
    """
    campaigns = list(campaigns)
    if all(isinstance(campaign, dict) for campaign in campaigns):
        return _vre.dicts_to_arrow([_text(campaign) for campaign in campaigns])
    return _vre.folders_to_arrow([os.fspath(folder) for folder in campaigns])


def answer_field(function="identify"):
    """Name and Arrow type of the column of answers of ``identify``, ``predict`` or ``diagnose``, for engines that ask beforehand.

    >>> import pyarrow, vre
    >>> field = pyarrow.field(vre.answer_field())
    >>> field.name, str(field.type.field("rank").type)
    ('answer', 'int64')
    """
    return _vre.answer_field(function)


def map_in_arrow(batches, function="identify", vibration=None, head=None):
    """For engines: record batches of pyarrow with a column ``campaign`` in, record batches with the column ``answer`` in its place
    out; other columns stay. A campaign that cannot be used has nulls and a ``reason``.

    Spark: ``frame.mapInArrow(vre.map_in_arrow, schema)``. Ray: ``map_batches`` with ``batch_format="pyarrow"``. Dask:
    ``delayed`` or ``map_partitions``. With ``functools.partial`` another function.

    >>> import pyarrow, vre
    >>> [answers] = vre.map_in_arrow([pyarrow.record_batch(vre.simulate(seed=[1, 2]))])
    >>> answers.schema.names, answers.column("answer")[0]["rank"].as_py()
    (['seed', 'true_k2_per_g', 'answer'], 11)
    """
    import pyarrow

    for batch in batches:
        if "campaign" not in batch.schema.names:
            raise InputError(f"there is no column campaign, only {', '.join(batch.schema.names)}")
        answers = _vre.of_arrow(function, _whole(batch.column("campaign")), vibration, head)
        answers = pyarrow.chunked_array(answers).combine_chunks()
        names = [name for name in batch.schema.names if name != "campaign"]
        columns = [batch.column(name) for name in names]
        yield pyarrow.record_batch([*columns, answers], [*names, "answer"])
