"""Writes the files of formats/ with the programs that people use for them.

    python3 -m venv venv
    venv/bin/pip install numpy scipy pyuff nptdms pyulog pyarrow mcap mcap-ros2-support pymavlink hdf5storage
    venv/bin/python write_formats.py

All hold one record: two axes at 200 Hz, 0.6 s at rest and 0.6 s under a sine of 40 Hz. Every value is a multiple of 2^-10 g,
which all formats hold exactly; record.csv has them as text.
"""

import io
import struct
from pathlib import Path

import hdf5storage
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pyuff
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from mcap_ros2.writer import Writer as Ros2Writer
from nptdms import ChannelObject, TdmsFile, TdmsWriter
from pymavlink import DFReader
from pyulog import ULog
from scipy.io import savemat, wavfile

OUT = Path(__file__).parent / "formats"
RATE_HZ = 200
COUNT = 240


def samples():
    state = 1
    rows = []
    for n in range(COUNT):
        noise = []
        for _ in range(2):
            state = (state * 1103515245 + 12345) % 2**31
            noise.append((state >> 16) % 9 - 4)
        shake = 1024 * np.sin(2 * np.pi * 40 * n / RATE_HZ + 0.3) + 16 if n >= COUNT // 2 else 0
        rows.append((round(shake) + noise[0], round(0.25 * shake) + 1024 + noise[1]))
    return np.array(rows, dtype=np.int16)


def ulog(path, t_us, x, y):
    """Built by the specification, then written again by pyulog."""

    def message(kind, content):
        return struct.pack("<HB", len(content), ord(kind)) + content

    name = b"uint64_t timestamp;float[2] acc_g;int16_t temperature;uint8_t[6] _padding0;"
    data = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0)
    data += message("B", bytes(40))
    data += message("F", b"sensor_accel:" + name)
    data += message("A", struct.pack("<BH", 0, 0) + b"sensor_accel")
    for t, a, b in zip(t_us, x, y):
        data += message("D", struct.pack("<HQffh", 0, t, a, b, 21))
    ULog(io.BytesIO(data)).write_ulog(str(path))


def dataflash(path, t_us, x, y):
    """Built by the specification; pymavlink must read it."""

    def fmt(kind, length, name, letters, labels):
        row = struct.pack("<BB4s16s64s", kind, length, name, letters, labels)
        return b"\xa3\x95\x80" + row

    data = fmt(0x80, 89, b"FMT", b"BBnNZ", b"Type,Length,Name,Format,Columns")
    data += fmt(0x81, 3 + 17, b"ACC", b"QBff", b"TimeUS,I,AccX,AccY")
    data += fmt(0x82, 3 + 8 + 1 + 16 + 16, b"FMTU", b"QBNN", b"TimeUS,FmtType,UnitIds,MultIds")
    data += fmt(0x83, 3 + 8 + 1 + 64, b"UNIT", b"QbZ", b"TimeUS,Id,Label")
    data += b"\xa3\x95\x83" + struct.pack("<Qb64s", 0, ord("o"), b"m/s/s")
    data += b"\xa3\x95\x82" + struct.pack("<QB16s16s", 0, 0x81, b"s#oo", b"F-00")
    for t, a, b in zip(t_us, x, y):
        data += b"\xa3\x95\x81" + struct.pack("<QBff", t, 0, a, b)
    path.write_bytes(data)
    log = DFReader.DFReader_binary(str(path))
    first = log.recv_match(type="ACC")
    assert (first.AccX, first.AccY) == (x[0], y[0])
    log.close() if hasattr(log, "close") else None


IMU = """
std_msgs/Header header
geometry_msgs/Vector3 linear_acceleration
float64[9] linear_acceleration_covariance
===
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
===
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
===
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
"""


def mcap(path, x, y):
    with path.open("wb") as stream:
        writer = Ros2Writer(stream)
        schema = writer.register_msgdef("sensor_msgs/msg/Imu", IMU.strip())
        for n, (a, b) in enumerate(zip(x, y)):
            at = 1_700_000_000 * 10**9 + n * 10**9 // RATE_HZ
            stamp = {"sec": at // 10**9, "nanosec": at % 10**9}
            writer.write_message(
                topic="/imu",
                schema=schema,
                message={
                    "header": {"stamp": stamp, "frame_id": "body"},
                    "linear_acceleration": {"x": float(a), "y": float(b), "z": 0.0},
                    "linear_acceleration_covariance": [0.0] * 9,
                },
                log_time=at + 1000,
                publish_time=at + 1000,
                sequence=n,
            )
        writer.finish()


def mcap_json(path, t, x, y):
    with path.open("wb") as stream:
        writer = McapWriter(stream, compression=CompressionType.LZ4)
        writer.start()
        schema = writer.register_schema("acc", "jsonschema", b'{"type": "object"}')
        channel = writer.register_channel("/acc", "json", schema)
        for n, (a, b) in enumerate(zip(x, y)):
            at = round(1e9 * t[n])
            text = '{"x_g": %r, "sensor": {"y_g": %r, "name": "A"}}' % (float(a), float(b))
            writer.add_message(channel, at, text.encode(), at, n)
        writer.finish()


def uff(path, t, x, y, binary):
    path.unlink(missing_ok=True)
    file = pyuff.UFF(str(path))
    for direction, (name, values) in enumerate([("x", x), ("y", y)], start=1):
        file.write_sets(
            {
                "type": 58, "binary": binary, "func_type": 1, "rsp_node": 3, "rsp_dir": direction, "ref_node": 1,
                "ref_dir": 1, "rsp_ent_name": name, "data": values, "x": t, "id1": name, "id2": "shaker", "abscissa_spacing": 1,
                "abscissa_spec_data_type": 17, "abscissa_axis_lab": "Time", "abscissa_axis_units_lab": "s",
                "ordinate_spec_data_type": 12, "ordinate_axis_lab": "Acceleration", "ordinate_axis_units_lab": "g",
                "orddenom_spec_data_type": 0,
            },
            "add",
        )


def main():
    OUT.mkdir(exist_ok=True)
    counts = samples()
    x, y = (counts[:, axis] / 1024 for axis in range(2))
    t = np.arange(COUNT) / RATE_HZ
    t_us = np.round(1e6 * t).astype(np.uint64)
    with (OUT / "record.csv").open("w") as table:
        table.write("t_s,x_g,y_g\n")
        table.writelines(f"{at!r},{a!r},{b!r}\n" for at, a, b in zip(t.tolist(), x.tolist(), y.tolist()))
    wavfile.write(OUT / "record.wav", RATE_HZ, counts)
    wavfile.write(OUT / "float.wav", RATE_HZ, np.stack([x, y], axis=1).astype(np.float32))
    table = pa.table({"t_s": t, "x_g": x.astype(np.float32), "y_g": y, "name": ["a"] * COUNT})
    pq.write_table(table, OUT / "record.parquet", row_group_size=100, compression="snappy")
    times = pa.array((1_700_000_000_000_000 + t_us.astype(np.int64)), type=pa.timestamp("us"))
    gappy = [None if n % 10 == 3 else value for n, value in enumerate(x.tolist())]
    table = pa.table({"time": times, "x_g": x, "y_counts": counts[:, 1], "gappy_g": gappy})
    pq.write_table(table, OUT / "stamped.parquet", compression="zstd")
    held = {"t_s": t, "x_g": x, "acc": counts, "log": {"y_g": y.astype(np.float32), "note": "bench"}}
    savemat(OUT / "record.mat", held, do_compression=True)
    savemat(OUT / "plain.mat", {"x_g": x.reshape(-1, 1), "y_g": y, "fs": 200.0})
    held = {"t_s": t, "x_g": x, "acc": counts, "log": {"y_g": y}}
    (OUT / "hdf5.mat").unlink(missing_ok=True)
    hdf5storage.savemat(str(OUT / "hdf5.mat"), held, format="7.3", oned_as="column", store_python_metadata=False)
    uff(OUT / "record.uff", t, x, y, 0)
    uff(OUT / "binary.uff", t, x, y, 1)
    with TdmsWriter(OUT / "record.tdms") as writer:
        told = {"wf_increment": 1 / RATE_HZ, "wf_start_offset": 0.0, "unit_string": "g"}
        for part in (slice(0, 90), slice(90, COUNT)):
            writer.write_segment([
                ChannelObject("shaker", "x", x[part], told),
                ChannelObject("shaker", "y", counts[part, 1], {**told, "unit_string": "counts"}),
            ])
    scales = {
        "NI_Scaling_Status": "unscaled", "NI_Number_Of_Scales": 2,
        "NI_Scale[0]_Scale_Type": "Linear", "NI_Scale[0]_Linear_Slope": 1 / 512, "NI_Scale[0]_Linear_Y_Intercept": 1.0,
        "NI_Scale[0]_Linear_Input_Source": 0xFFFFFFFF,
        "NI_Scale[1]_Scale_Type": "Polynomial", "NI_Scale[1]_Polynomial_Coefficients_Size": 2,
        "NI_Scale[1]_Polynomial_Coefficients[0]": -0.5, "NI_Scale[1]_Polynomial_Coefficients[1]": 0.5,
        "NI_Scale[1]_Polynomial_Input_Source": 0,
    }
    with TdmsWriter(OUT / "scaled.tdms") as writer:
        writer.write_segment([ChannelObject("a", "x", counts[:, 0], scales), ChannelObject("b", "x", counts[:, 0])])
    assert (TdmsFile.read(OUT / "scaled.tdms")["a"]["x"][:] == x).all()
    ulog(OUT / "record.ulg", t_us, x, y)
    dataflash(OUT / "record.bin", t_us, x, y)
    mcap(OUT / "record.mcap", x, y)
    mcap_json(OUT / "json.mcap", t, x, y)


main()
