"""One signal in every kind of file reads back as the same samples."""

import h5py
import numpy as np
import pytest
import pyuff
import scipy.io
from nptdms import ChannelObject, TdmsWriter

from jointscope.errors import CampaignError
from jointscope.recordings.files import open_data_file
from jointscope.recordings.reader import read_campaign

RATE = 512.0
N = 200


@pytest.fixture
def signals(rng):
    return rng.standard_normal((3, N))


def time_record(values, node, direction=3):
    return {
        "type": 58, "binary": 0, "id1": "run 1", "id2": "", "id3": "", "id4": "", "id5": "", "func_type": 1,
        "ver_num": 0, "load_case_id": 0, "rsp_ent_name": "ARM", "rsp_node": node, "rsp_dir": direction,
        "ref_ent_name": "NONE", "ref_node": 0, "ref_dir": 0, "ord_data_type": 4, "num_pts": N, "abscissa_spacing": 1,
        "abscissa_min": 0.0, "abscissa_inc": 1 / RATE, "z_axis_value": 0.0, "abscissa_spec_data_type": 17,
        "ordinate_spec_data_type": 12, "ordinate_axis_units_lab": "m/s^2", "orddenom_spec_data_type": 0,
        "data": values, "x": np.arange(N) / RATE,
    }  # fmt: skip


def frf_record(values, frequency, kind=4, node=101):
    record = time_record(values, node)
    return record | {
        "func_type": kind, "ref_node": 5, "ref_dir": -3, "num_pts": frequency.size, "abscissa_min": frequency[0],
        "abscissa_inc": frequency[1] - frequency[0], "abscissa_spec_data_type": 18, "orddenom_spec_data_type": 13,
        "ord_data_type": 6 if kind == 4 else 4, "x": frequency,
    }  # fmt: skip


def headers():
    header = {
        "type": 151, "model_name": "bench", "description": "arm", "db_app": "", "date_db_created": "01-Mar-26",
        "time_db_created": "10:00:00", "version_db1": 0, "version_db2": 0, "file_type": 0,
        "date_db_saved": "01-Mar-26", "time_db_saved": "10:00:00", "program": "lab",
        "date_file_written": "01-Mar-26", "time_file_written": "10:00:00",
    }  # fmt: skip
    units = {
        "type": 164, "units_code": 1, "units_description": "SI", "temp_mode": 1, "length": 1.0, "force": 1.0,
        "temp": 1.0, "temp_offset": 273.15,
    }  # fmt: skip
    nodes = {
        "type": 15, "node_nums": [101, 102], "def_cs": [0, 0], "disp_cs": [0, 0], "color": [0, 0],
        "x": [0.8, 0.95], "y": [0.0, 0.0], "z": [0.0, 0.0],
    }  # fmt: skip
    shape = {
        "type": 55, "id1": "", "id2": "", "id3": "", "id4": "", "id5": "", "model_type": 1, "analysis_type": 2,
        "data_ch": 2, "spec_data_type": 8, "data_type": 2, "n_data_per_node": 3, "load_case": 1, "mode_n": 1,
        "freq": 40.0, "modal_m": 1.0, "modal_damp_vis": 0.0, "modal_damp_his": 0.0, "node_nums": [101, 102],
        "r1": [0.0, 0.0], "r2": [0.0, 0.0], "r3": [1.0, 1.2],
    }  # fmt: skip
    return [header, nodes, shape, units]


def test_uff_time_data_among_headers_by_number_and_by_degree_of_freedom(tmp_path, signals):
    path = tmp_path / "a.uff"
    records = [time_record(signals[0], 101), time_record(signals[1], 102, -3), time_record(signals[2], 102, 1)]
    pyuff.UFF(str(path)).write_sets(headers() + records, mode="overwrite")
    found = open_data_file(path)
    assert list(found.columns) == ["1", "2", "3"]
    for name, values in (
        ("1", signals[0]),
        ("101:+Z", signals[0]),
        ("102:-Z", signals[1]),
        ("102:+X", signals[2]),
    ):
        np.testing.assert_allclose(found.find(name).read(), values, rtol=1e-7)
    column = found.find("101:+Z")
    assert column.rate == pytest.approx(RATE, rel=1e-5)  # printed with six digits
    assert column.unit == "m/s^2"


@pytest.mark.filterwarnings("ignore::ResourceWarning")  # pyuff leaves a handle open where it writes binary
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("binary", [0, 1])
def test_uff_frf_with_its_coherence_becomes_an_frf_stream(tmp_path, rng, binary):
    frequency = np.linspace(1.0, 100.0, 100)
    H = rng.standard_normal(100) + 1j * rng.standard_normal(100)
    records = [frf_record(H, frequency), frf_record(np.linspace(0.5, 1.0, 100), frequency, kind=6)]
    for record in records:
        record["binary"] = binary
    pyuff.UFF(str(tmp_path / "frf.uff")).write_sets(headers() + records, mode="overwrite")
    (tmp_path / "campaign.toml").write_text(
        'format = "jointscope-campaign/1"\n[rig]\ntopology = "single-dof"\nmotion = "rotational"\n'
        '[[run]]\nid = "a"\nexperiment = "hammer"\narm_angle = 0.0\nbrake = true\n'
        '[[run.stream]]\nfile = "frf.uff"\nchannels = [{ column = "101:+Z", quantity = "frf", unit = "m/s^2/N",'
        ' form = "accelerance", location = "arm", radius = 0.8, role = "output", averages = 20 }]\n'
    )
    stream = read_campaign(tmp_path).runs[0].streams[0]
    np.testing.assert_allclose(stream.frequency, frequency, rtol=1e-5)
    np.testing.assert_allclose(stream.channels[0].samples, H, rtol=1e-5)
    np.testing.assert_allclose(stream.channels[0].coherence, np.linspace(0.5, 1.0, 100), rtol=1e-5)
    assert stream.channels[0].averages == 20


def test_tdms_by_group_and_channel(tmp_path, signals):
    path = tmp_path / "a.tdms"
    properties = {"wf_increment": 1 / RATE, "unit_string": "N", "wf_start_offset": 0.0}
    with TdmsWriter(path) as writer:
        writer.write_segment([ChannelObject("hits", "force/1", signals[0], properties=properties)])
        writer.write_segment([ChannelObject("hits", "force/1", signals[1], properties=properties)])
        writer.write_segment([ChannelObject("log", "text", ["a", "b"])])
    found = open_data_file(path)
    assert list(found.columns) == ["hits/force/1"]
    column = found.find("hits/force/1")
    np.testing.assert_array_equal(column.read(), np.concatenate(signals[:2]))
    assert (column.rate, column.unit, column.length) == (pytest.approx(RATE), "N", 2 * N)


def test_mat_structs_cells_and_matrices_by_path(tmp_path, signals):
    path = tmp_path / "a.mat"
    cells = np.empty(2, dtype=object)
    cells[:] = [signals[0], signals[1]]
    scipy.io.savemat(
        path, {"a": {"b": signals.T, "c": {"d": signals[0]}}, "row": signals[:1], "cell": cells, "gain": 2.5}
    )
    found = open_data_file(path)
    np.testing.assert_array_equal(found.find("a.b[2]").read(), signals[2])
    np.testing.assert_array_equal(found.find("a.c.d").read(), signals[0])
    np.testing.assert_array_equal(found.find("row").read(), signals[0])
    np.testing.assert_array_equal(found.find("cell[1]").read(), signals[1])
    assert found.find("gain") is None


def test_mat_of_version_7_3_has_the_same_paths(tmp_path, signals):
    path = tmp_path / "a.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        file["a/b"] = signals  # MATLAB's columns are HDF5's rows
        file["row"] = signals[:1].T
        reference = np.empty((1, 2), dtype=h5py.ref_dtype)
        for k in range(2):
            reference[0, k] = file.create_dataset(f"#refs#/{k}", data=signals[k]).ref
        file.create_dataset("cell", data=reference)
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(128))
    found = open_data_file(path)
    np.testing.assert_array_equal(found.find("a.b[2]").read(), signals[2])
    np.testing.assert_array_equal(found.find("row").read(), signals[0])
    np.testing.assert_array_equal(found.find("cell[1]").read(), signals[1])


def test_npz_and_hdf5_matrices_by_column(tmp_path, signals):
    np.savez(tmp_path / "a.npz", hits=signals.T, one=signals[0])
    with h5py.File(tmp_path / "a.h5", "w") as file:
        item = file.create_dataset("take/hits", data=signals.T)
        item.attrs["unit"] = "N"
        item.attrs["sampling_rate"] = RATE
        file["one"] = signals[0]
    archive, hdf = open_data_file(tmp_path / "a.npz"), open_data_file(tmp_path / "a.h5")
    np.testing.assert_array_equal(archive.find("hits[1]").read(), signals[1])
    np.testing.assert_array_equal(hdf.find("take/hits[1]").read(), signals[1])
    np.testing.assert_array_equal(hdf.find("/one").read(), archive.find("one").read())
    assert (hdf.find("take/hits[1]").rate, hdf.find("take/hits[1]").unit) == (RATE, "N")


def test_pickled_objects_are_refused(tmp_path):
    np.savez(tmp_path / "a.npz", bad=np.array([{"a": 1}], dtype=object))
    with pytest.raises(CampaignError, match=r"a\.npz"):
        open_data_file(tmp_path / "a.npz")


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_csv_separators_decimal_commas_and_texts_beside_numbers(tmp_path, signals, separator):
    comma = separator == ";"
    cells = [
        ["monday", *(repr(float(v)).replace(".", ",") if comma else repr(float(v)) for v in row)]
        for row in signals.T
    ]
    text = "\ufeff" + separator.join(["when", "a", '"b, c"', "d"])
    (tmp_path / "a.csv").write_text(text + "\n" + "\n".join(separator.join(row) for row in cells) + "\n", "utf-8")
    found = open_data_file(tmp_path / "a.csv")
    np.testing.assert_array_equal(found.find("a").read(), signals[0])
    np.testing.assert_array_equal(found.find("b, c").read(), signals[1])
    with pytest.raises(CampaignError, match="when = 'monday'"):
        found.find("when").read()


def lvm(multi_headings, x_columns, segments, names=("F", "a"), comma=False):
    """LVM text with ``segments`` of (declared samples, rows (n, channels))."""
    lines = ["LabVIEW Measurement\t", "Writer_Version\t2", "Reader_Version\t2", "Separator\tTab"]
    lines += ["Decimal_Separator\t,"] if comma else []
    lines += [f"Multi_Headings\t{multi_headings}", f"X_Columns\t{x_columns}", "***End_of_Header***\t", "\t"]
    k = len(names)
    for samples, rows in segments:
        lines += [
            f"Channels\t{k}",
            "Samples" + f"\t{samples}" * k,
            "Y_Unit_Label\tN\tm/s^2",
            "X_Dimension\tTime\tTime",
        ]
        lines += ["X0" + "\t0.0E+0" * k, "Delta_X" + f"\t{1 / RATE!r}" * k, "***End_of_Header***\t\t\t"]
        heads = ["X_Value", *names] if x_columns != "Multi" else ["X_Value", names[0], "X_Value", names[1]]
        lines += ["\t".join([*heads, "Comment"])]
        for i, row in enumerate(rows):
            x = repr(i / RATE)
            cells = {
                "No": ["", *map(repr, row)],
                "One": [x, *map(repr, row)],
                "Multi": [x, repr(row[0]), x, repr(row[1])],
            }
            lines.append("\t".join(cells[x_columns]))
    text = "\n".join(lines) + "\n"
    return text.replace(".", ",") if comma else text


@pytest.mark.parametrize("x_columns", ["No", "One", "Multi"])
@pytest.mark.parametrize("comma", [False, True])
def test_lvm_of_one_record(tmp_path, signals, x_columns, comma):
    (tmp_path / "a.lvm").write_text(lvm("No", x_columns, [(N, signals[:2].T.tolist())], comma=comma))
    found = open_data_file(tmp_path / "a.lvm")
    assert list(found.columns) == ["F", "a"]
    np.testing.assert_array_equal(found.find("F").read(), signals[0])
    np.testing.assert_array_equal(found.find("a").read(), signals[1])
    assert (found.find("a").rate, found.find("a").unit) == (pytest.approx(RATE), "m/s^2")


def test_lvm_of_several_records_under_repeated_headers(tmp_path, signals):
    rows = signals[:2].T.tolist()
    (tmp_path / "a.lvm").write_text(lvm("Yes", "No", [(120, rows[:120]), (80, rows[120:])]))
    found = open_data_file(tmp_path / "a.lvm")
    assert list(found.columns) == ["1/F", "1/a", "2/F", "2/a"]
    np.testing.assert_array_equal(found.find("2/a").read(), signals[1][120:])


def test_lvm_of_several_records_stacked_under_one_header(tmp_path, signals):
    (tmp_path / "a.lvm").write_text(lvm("No", "No", [(100, signals[:2].T.tolist())]))
    found = open_data_file(tmp_path / "a.lvm")
    np.testing.assert_array_equal(found.find("1/F").read(), signals[0][:100])
    np.testing.assert_array_equal(found.find("2/a").read(), signals[1][100:])


def test_a_rate_that_contradicts_the_file_is_refused(small, signals):
    with TdmsWriter(small / "a.tdms") as writer:
        for name, values in zip(("force", "acc"), signals, strict=False):
            writer.write_segment([ChannelObject("g", name, values, properties={"wf_increment": 1 / RATE})])
    text = (small / "campaign.toml").read_text().replace("a.csv", "a.tdms")
    text = text.replace('column = "', 'column = "g/')
    (small / "campaign.toml").write_text(text)
    with pytest.raises(CampaignError, match=r"sampling_rate = 1024.0: the file itself says 512 Hz"):
        read_campaign(small)
    (small / "campaign.toml").write_text(text.replace("1024.0", "512.0"))
    np.testing.assert_array_equal(read_campaign(small).runs[0].signals[0].samples, signals[0])


def test_an_unknown_suffix_is_refused(tmp_path):
    (tmp_path / "a.xyz").write_text("")
    with pytest.raises(CampaignError, match=r"a\.xyz: unknown kind of file"):
        open_data_file(tmp_path / "a.xyz")
