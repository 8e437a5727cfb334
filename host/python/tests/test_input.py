"""Bad input is an exception of one line that names the place, and never ends the interpreter."""

import copy
import pickle

import pyarrow as pa
import pytest
import vre


def refused(function, *arguments, **options):
    with pytest.raises(vre.InputError) as raised:
        function(*arguments, **options)
    told = str(raised.value)
    assert told and "\n" not in told and "panic" not in told, told
    return raised.value


def place(error):
    return error.file, error.row, error.column


def test_a_bad_table_is_named_with_row_and_column(folders, tmp_path):
    for name in ("campaign.toml", "static.csv"):
        text = (folders[0] / name).read_text()
        (tmp_path / name).write_text(text.replace("ccw", "west", 1))
    error = refused(vre.identify, tmp_path)
    assert place(error) == (str(tmp_path / "static.csv"), 2, "approach")
    assert "west" in str(error)
    assert refused(vre.diagnose, tmp_path / "nowhere").file == str(tmp_path / "nowhere")


@pytest.mark.parametrize(
    "table, column, value, file",
    [
        ("readings", "u_v", "1,2", "static.csv"),
        ("readings", "u_v", float("nan"), "static.csv"),
        ("readings", "u_v", None, "static.csv"),
        ("readings", "approach", "west", "static.csv"),
        ("readings", "series", 4, "static.csv"),
        ("readings", "order", -1, "static.csv"),
        ("readings", "sigma_v", 0.0, "static.csv"),
        ("runs", "kind", "noise", "vibration.csv"),
        ("runs", "level_g", [1], "vibration.csv"),
        ("runs", "sigma_v", None, "vibration.csv"),
    ],
)
def test_a_bad_dict_is_named_with_row_and_column(folders, table, column, value, file):
    campaign = vre.read(folders[0])
    campaign[table][2][column] = value
    error = refused(vre.identify, campaign)
    told = "u_before_v" if (table, column) == ("runs", "sigma_v") else column
    assert place(error) == (file, 4, told), error


def test_a_dict_needs_no_more_than_the_tables_have(folders):
    campaign = vre.read(folders[0])
    few = {"toml": campaign["toml"], "readings": copy.deepcopy(campaign["readings"])}
    for reading in few["readings"]:
        for key in ("session", "exclude", "line", "further"):
            del reading[key]
    assert vre.identify(few)["coefficients"] == vre.identify(folders[0])["coefficients"]
    del few["readings"][5]["temp_c"]
    error = refused(vre.identify, few)
    assert (error.file, error.row) == ("static.csv", 7) and "temp_c" in str(error)
    assert "readings" in str(refused(vre.identify, {"toml": ""}))
    assert "set" in str(refused(vre.identify, {"toml": {1}}))


def test_a_bad_row_of_arrow_is_null_with_a_reason(folders):
    good = vre.read(folders[0])
    bad = dict(good, readings=good["readings"][:5])
    column = pa.array([good, bad, None], type=pa.array(vre.arrow(folders)).type)
    answers = pa.chunked_array(vre.identify(column)).to_pylist()
    assert answers[0]["reason"] is None and answers[2] is None
    assert answers[1]["coefficients"] is None and "5 readings" in answers[1]["reason"]


def test_arrow_without_campaigns_is_refused(batch):
    assert "number" in str(refused(vre.identify, batch.select(["number"])))
    assert "int64" in str(refused(vre.identify, pa.array([1, 2]))).lower()
    assert "number" in str(refused(lambda: list(vre.map_in_arrow([batch.select(["number"])]))))
    assert len(pa.chunked_array(vre.identify(batch.slice(0, 0)))) == 0


@pytest.mark.parametrize("words", ["noise:1", "random", "random:-1", "random:nan", "sine:"])
def test_other_words_for_a_vibration_are_refused(folders, words):
    assert words in str(refused(vre.predict, folders[0], words))


def test_numbers_out_of_their_range_are_refused(tmp_path):
    assert "dial_sigma_arcsec" in str(refused(vre.simulate, dial_sigma_arcsec=-1.0))
    assert "strength" in str(refused(vre.simulate, strength=float("nan")))
    assert "plan" in str(refused(vre.simulate, plan="all"))
    assert "quake" in str(refused(vre.simulate, effects=["quake"]))
    vre.simulate(tmp_path)
    assert "force" in str(refused(vre.simulate, tmp_path))


def test_a_record_that_cannot_be_measured_is_refused(tmp_path):
    def measured(**columns):
        return refused(vre.measure, columns, ["x"], units_per_g=1.0)

    assert place(measured(x=[1.0, "a"])) == ("record", None, "x")
    assert place(measured(x=[1.0, 2.0], y=[1.0])) == ("record", None, None)
    assert measured(y=[1.0, 2.0]).file == "record"
    broken = measured(x=[0.0] * 500 + [float("nan")] + [0.0] * 500)
    assert (broken.file, broken.column) == ("record", "x") and "501" in str(broken)
    assert "units_per_g" in str(refused(vre.measure, {"x": [0.0] * 10}, ["x"]))
    assert "units_per_g" in str(refused(vre.measure, {"x": [0.0] * 10}, ["x"], units_per_g=0.0))
    assert "before" in str(refused(vre.measure, {"x_g": [0.0] * 10}, before="0..1"))
    empty = tmp_path / "empty.csv"
    empty.write_text("")
    assert refused(vre.measure, empty, ["x"], units_per_g=1.0).file == str(empty)


def test_a_panic_of_the_reader_of_arrow_does_not_cross_the_border(batch):
    # What pyarrow does not make whole beforehand.
    error = refused(vre._vre.of_arrow, "identify", batch.column("campaign").slice(1, 1))
    assert "structs within structs" in str(error)


def test_the_exception_travels_between_processes():
    error = vre.InputError("static.csv, row 2: is empty", "static.csv", 2, "u_v")
    back = pickle.loads(pickle.dumps(error))
    assert (str(back), place(back)) == (str(error), place(error))
