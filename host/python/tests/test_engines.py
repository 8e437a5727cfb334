"""Campaigns come from engines and go back to them: Polars, pandas, DuckDB, and Dask on two processes."""

import json
import multiprocessing
import os
import subprocess

import dask
import duckdb
import pandas
import polars
import pyarrow as pa
import pytest
import vre


@pytest.fixture(scope="module")
def expected(folders):
    return [vre.identify(folder)["coefficients"]["k2_per_g"]["value"] for folder in folders]


def k2(answers):
    return [row["coefficients"]["k2_per_g"]["value"] for row in pa.chunked_array(answers).to_pylist()]


def test_polars_hands_over_campaigns_and_reads_answers(batch, expected):
    frame = polars.from_arrow(pa.table(batch))
    answers = polars.Series(vre.identify(frame))
    read = frame.with_columns(answers).select(
        polars.col("answer").struct.field("coefficients").struct.field("k2_per_g").struct.field("value")
    )
    assert read.to_series().to_list() == expected
    assert k2(vre.identify(frame["campaign"])) == expected


@pytest.mark.skipif("VRE_FLEET" not in os.environ, reason="VRE_FLEET names no command vre-fleet")
def test_polars_and_sql_give_the_same_of_a_data_set(tmp_path):
    fleet, plant, out = os.environ["VRE_FLEET"], tmp_path / "plant", tmp_path / "out.json"
    subprocess.run([fleet, "simulate", "--out", plant, "--instruments", "5"], capture_output=True, check=True)
    sql = "SELECT serial, vre_identify(campaign)['coefficients']['k2_per_g']['value'] AS k2 FROM campaigns"
    subprocess.run([fleet, "query", plant, sql, "--out", out], capture_output=True, check=True)
    of_sql = {row["serial"]: row["k2"] for row in json.loads(out.read_text())}
    frame = polars.read_parquet(f"{plant}/**/*.parquet", hive_partitioning=True)
    answers = polars.Series(vre.identify(frame))
    assert dict(zip(frame["serial"], k2(answers), strict=True)) == of_sql and len(of_sql) == 5


def test_pandas_hands_over_campaigns_that_it_holds_as_dicts(folders, batch, expected):
    of_arrow = pa.table(batch).to_pandas(types_mapper=pandas.ArrowDtype)
    assert k2(vre.identify(of_arrow)) == expected
    of_dicts = pandas.DataFrame({"campaign": [vre.read(folder) for folder in folders]})
    assert k2(vre.identify(of_dicts)) == expected


def test_duckdb_hands_over_campaigns_and_reads_answers(batch, expected):
    campaigns = pa.table(batch)
    held = duckdb.sql("SELECT number, campaign FROM campaigns ORDER BY number")
    found = pa.table({"answer": pa.chunked_array(vre.identify(held))})
    read = duckdb.sql("SELECT answer.coefficients.k2_per_g.value FROM found").fetchall()
    assert [value for (value,) in read] == expected


def test_a_slice_gives_the_answers_of_its_rows(batch, expected):
    for number in range(3):
        part = batch.slice(number, 1)
        assert k2(vre.identify(part)) == expected[number : number + 1]
        assert k2(vre.identify(part.column("campaign"))) == expected[number : number + 1]
        assert k2(vre.identify(pa.table(batch).slice(number, 1))) == expected[number : number + 1]
        frame = pa.table(batch).to_pandas(types_mapper=pandas.ArrowDtype)
        assert k2(vre.identify(frame.iloc[number : number + 1])) == expected[number : number + 1]
        frame = polars.from_arrow(pa.table(batch))
        assert k2(vre.identify(frame[number : number + 1])) == expected[number : number + 1]


def mapped(part):
    return os.getpid(), pa.Table.from_batches(vre.map_in_arrow([part]))


def test_dask_maps_batches_on_two_processes(batch, expected):
    parts = [dask.delayed(mapped)(batch.slice(number % 3, 1)) for number in range(8)]
    made = dask.compute(*parts, scheduler="processes", num_workers=2)
    processes = {process for process, _ in made}
    assert len(processes) == 2 and os.getpid() not in processes
    found = pa.concat_tables([table for _, table in made])
    assert found.column("number").to_pylist() == [number % 3 for number in range(8)]
    assert k2(found.column("answer")) == [expected[number % 3] for number in range(8)]


def of_folder(folder):
    return vre.identify(folder)["coefficients"]["k2_per_g"]["value"]


def of_column(folder):
    return k2(vre.identify(vre.arrow([folder])))[0]


def test_a_forked_process_answers_after_its_parent_has(folders, expected):
    for function in (of_folder, of_column):
        assert function(folders[0]) == expected[0]
        with multiprocessing.get_context("fork").Pool(2) as pool:
            assert pool.map_async(function, folders).get(timeout=60) == expected


def test_answers_have_the_type_that_is_told_beforehand(batch):
    for function in ("identify", "predict", "diagnose"):
        [answers] = vre.map_in_arrow([batch.slice(0, 1)], function)
        assert answers.schema.field("answer") == pa.field(vre.answer_field(function))


def unsigned(kind):
    if kind.num_fields:
        return any(unsigned(kind.field(index).type) for index in range(kind.num_fields))
    return pa.types.is_unsigned_integer(kind)


def test_answers_have_no_unsigned_integers_which_spark_has_not():
    for function in ("identify", "predict", "diagnose"):
        assert not unsigned(pa.field(vre.answer_field(function)).type), function
