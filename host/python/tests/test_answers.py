"""The wheel answers on folders, dicts and Arrow as the command does, and runs beside other threads."""

import doctest
import json
import os
import subprocess
import threading
import time

import numpy
import pyarrow as pa
import pytest
import vre


def rows(answers):
    return pa.chunked_array(answers).to_pylist()


def test_examples_of_the_docstrings_run():
    failed, tried = doctest.testmod(vre)
    assert tried > 20 and failed == 0


@pytest.mark.parametrize(
    "function",
    [vre.identify, vre.predict, lambda c: vre.predict(c, "random:1"), vre.diagnose],
    ids=["identify", "predict", "predict a vibration", "diagnose"],
)
def test_folder_dict_and_arrow_give_the_same(folders, batch, function):
    for folder, row in zip(folders, rows(function(batch)), strict=True):
        of_folder = function(folder)
        assert function(vre.read(folder)) == of_folder
        assert row["reason"] is None
        common = [key for key in row if key in of_folder]
        assert len(common) > 3
        for key in common:
            assert contains(of_folder[key], row[key]), key


def contains(whole, part):
    """Whether an answer holds all that a row of Arrow has of it; a field that is null there may be absent."""
    if isinstance(part, dict):
        return all(value is None and key not in whole or contains(whole[key], value) for key, value in part.items())
    if isinstance(part, list):
        return len(whole) == len(part) and all(contains(a, b) for a, b in zip(whole, part))
    return whole == part


@pytest.mark.skipif("VRE" not in os.environ, reason="VRE names no command vre")
@pytest.mark.parametrize(
    "command, function",
    [("identify", vre.identify), ("predict", vre.predict), ("diagnose", vre.diagnose)],
)
def test_the_answer_is_that_of_the_command(folders, command, function):
    said = subprocess.run([os.environ["VRE"], command, folders[1], "--json", "-"], capture_output=True, check=True)
    assert json.loads(said.stdout) == function(folders[1])


@pytest.mark.skipif("VRE" not in os.environ, reason="VRE names no command vre")
def test_a_simulated_folder_is_that_of_the_command(tmp_path):
    ours, theirs = tmp_path / "ours", tmp_path / "theirs"
    vre.simulate(ours, seed=5, effects=["sextic"], strength=2, imperfections=["gross-run"])
    options = ["--seed", "5", "--effect", "sextic", "--strength", "2", "--imperfection", "gross-run"]
    subprocess.run([os.environ["VRE"], "simulate", "--out", theirs, *options], capture_output=True, check=True)
    names = sorted(file.name for file in theirs.iterdir())
    assert sorted(file.name for file in ours.iterdir()) == names
    for name in names:
        assert (ours / name).read_bytes() == (theirs / name).read_bytes(), name


def test_simulated_folder_dict_and_batch_are_one_campaign(tmp_path):
    truth = vre.simulate(tmp_path / "one", seed=4)
    made = vre.simulate(seed=4)
    assert made["truth"] == truth
    assert vre.identify(made["campaign"]) == vre.identify(tmp_path / "one")
    several = pa.record_batch(vre.simulate(seed=[4, 5]))
    assert several.column("true_k2_per_g")[0].as_py() == truth["coefficients"][3]
    assert rows(vre.identify(several))[0]["coefficients"] == vre.identify(made["campaign"])["coefficients"]


@pytest.mark.skipif("VRE" not in os.environ, reason="VRE names no command vre")
def test_a_known_head_enters_as_with_the_command_and_one_that_is_contradicted_is_refused(tmp_path):
    first, other, head = tmp_path / "first", tmp_path / "other", tmp_path / "head.toml"
    for seed, folder in enumerate([first, other]):
        vre.simulate(folder, seed=seed, plan="remounted", dial_sigma_arcsec=20.0)
    subprocess.run([os.environ["VRE"], "identify", first, "--teach", head], capture_output=True, check=True)
    command = [os.environ["VRE"], "identify", first, "--head", head, "--json", "-"]
    said = json.loads(subprocess.run(command, capture_output=True, check=True).stdout)
    assert vre.identify(first, head=head) == said
    assert vre.identify(vre.read(first), head=head) == said
    assert said != vre.identify(first)
    known, contradicted = rows(vre.identify(vre.arrow([first, other]), head=head))
    assert known["coefficients"] == said["coefficients"]
    assert contradicted["coefficients"] is None and "contradict" in contradicted["reason"]
    with pytest.raises(vre.InputError) as raised:
        vre.identify(other, head=head)
    assert raised.value.file == str(head)


def shaken(seed=1, shift_g=0.05):
    generator = numpy.random.default_rng(seed)
    t = numpy.arange(40_000) / 1000
    moving = (t >= 15) & (t < 25)
    x = generator.normal(0, 1e-3, t.size) + moving * (shift_g + numpy.sin(500 * t))
    return {"t_s": t, "x_g": x}


def test_a_shift_is_measured_alike_in_a_table_a_dict_and_arrow(tmp_path):
    record = shaken()
    table = tmp_path / "record.csv"
    pairs = zip(record["t_s"].tolist(), record["x_g"].tolist())
    table.write_text("t_s,x_g\n" + "".join(f"{t!r},{x!r}\n" for t, x in pairs))
    of_table, of_dict, of_arrow = (vre.measure(one) for one in (table, record, pa.table(record)))
    [plateau] = of_table["plateaus"]
    assert abs(plateau["shift_g"]["value"] - 0.05) < 5 * plateau["shift_g"]["sigma"]
    assert plateau["verdict"] == "shift"
    for other in (of_dict, of_arrow):
        assert other["input"] == "record"
        assert other["plateaus"][0]["shift_g"] == plateau["shift_g"]
    windows = vre.measure(record, ["x_g"], units_per_g=1.0, time="t_s", before="0..14", during="16..24")
    assert abs(windows["axes"][0]["shift_g"]["value"] - 0.05) < 1e-3


def test_other_threads_run_while_a_campaign_is_diagnosed(folders):
    ticks = []
    done = threading.Event()

    def tick():
        while not done.is_set():
            ticks.append(time.monotonic())
            time.sleep(0.002)

    thread = threading.Thread(target=tick)
    thread.start()
    start = time.monotonic()
    vre.diagnose(folders[0])
    took = time.monotonic() - start
    done.set()
    thread.join()
    # With the lock held there would be none but at the two ends.
    within = [t for t in ticks if start + 0.1 * took <= t <= start + 0.9 * took]
    assert len(within) >= 5, took
