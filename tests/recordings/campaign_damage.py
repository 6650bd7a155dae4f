"""What may happen to a campaign's files: bytes, lines, cells and arrays that are not what they should be."""

import io
import json

import h5py
import numpy as np

ODD_TEXTS = [
    "",
    " ",
    "\x00",
    "\u202e",
    "ß" * 300,
    "../x",
    "/etc/passwd",
    "a" * 5000,
    "ﬀ😀",
    "nan",
    "%s%n",
    "\\",
    "'",
    '"',
    "N",
]
ODD_NUMBERS = [
    "nan",
    "inf",
    "-inf",
    "0",
    "-1",
    "1e308",
    "1e-308",
    "-0.0",
    "9" * 400,
    "9" * 5000,
    "1_0",
    "0x10",
    "1e400",
    "64",
]
ODD_VALUES = [*ODD_NUMBERS, "true", "[]", "{}", "[[1]]", '["a"]', "1979-05-27", "07:32:00", '"unknown"', '""', "[1.0, 2.0, 3.0]",
              '{ a = { b = { c = 1 } } }', "[nan, 1.0]", "[0.3, 0.1]", "'text'", '"""x\ny"""', "[" * 3000,
              "[" * 90 + "]" * 90]  # fmt: skip
ODD_CELLS = ["", "nan", "inf", "-inf", "1e400", "oops", "1;2", '"', '"1', "0x1p3", "1,5", "٣", "1j", "9" * 5000,
             " 1 ", "--1", "1e", "\x00",
             "x" * 200_000, "-"]  # fmt: skip


def damage_bytes(data, rng):
    """Truncated, flipped, cut out, doubled, filled, or wrapped."""
    if not data:
        return bytes(rng.integers(0, 256, 20, dtype=np.uint8))
    a, b = sorted(int(x) for x in rng.integers(0, len(data) + 1, 2))
    b = min(b, a + 400)
    noise = bytes(rng.integers(0, 256, int(rng.integers(1, 60)), dtype=np.uint8))
    flipped = bytearray(data)
    for at in rng.integers(0, len(data), int(rng.integers(1, 12))):
        flipped[at] ^= 1 << int(rng.integers(0, 8))
    ways = [
        data[:a], data[a:], bytes(flipped), data[:a] + data[b:], data[:b] + data[a:], data[:a] + noise + data[a:], b"",
        data[:a] + bytes(b - a) + data[b:], b"\xef\xbb\xbf" + data, data.replace(b"\n", b"\r\n"), data.replace(b"\n", b"\r"),
        data + data, b"\xff\xfe" + data.decode("latin-1").encode("utf-16-le"), data.replace(b" ", b"\xc2\xa0"), noise,
        data.replace(b"\n", b"\n\n"), data + b"\x00" * 100, data.replace(b"0", b"9", 5),
    ]  # fmt: skip
    return ways[int(rng.integers(len(ways)))]


def damage_toml(text, rng):
    """A line dropped, doubled, moved, its key or value replaced, or nested too deep."""
    lines = text.split("\n")
    at = int(rng.integers(len(lines)))
    way = int(rng.integers(9))
    value = ODD_VALUES[int(rng.integers(len(ODD_VALUES)))]
    if rng.random() < 0.3:
        value = json.dumps(ODD_TEXTS[int(rng.integers(len(ODD_TEXTS)))])
    if way == 0:
        del lines[at]
    elif way == 1:
        lines.insert(at, lines[int(rng.integers(len(lines)))])
    elif way in (2, 3, 4):
        equal = [k for k, line in enumerate(lines) if "=" in line]
        at = equal[int(rng.integers(len(equal)))] if equal else at
        if "{" in lines[at]:
            parts = lines[at].split("=")
            k = int(rng.integers(1, len(parts)))
            head, comma, tail = parts[k].partition(",")
            parts[k] = f" {value}" + (" }," if not tail and "}" in head else comma + tail)
            lines[at] = "=".join(parts)
        else:
            lines[at] = lines[at].split("=")[0] + "= " + value
    elif way == 5:
        lines[at] = lines[at].replace("column", "colunm").replace("file", "fi le").replace("r", "R", 1)
    elif way == 6:
        lines.insert(at, f"extra = {value}")
    elif way == 7:
        lines.insert(at, "a." * int(rng.integers(1, 2500)) + f"b = {value}")
    else:
        lines.insert(at, f"[[run{'.stream' * int(rng.integers(0, 3))}]]")
    return "\n".join(lines)


def damage_csv(text, rng):
    """Cells, columns and lines that are not what they should be."""
    lines = text.split("\n")
    at = int(rng.integers(len(lines)))
    cells = lines[at].split(",")
    way = int(rng.integers(10))
    if way < 4:
        cells[int(rng.integers(len(cells)))] = ODD_CELLS[int(rng.integers(len(ODD_CELLS)))]
        lines[at] = ",".join(cells)
    elif way == 4:
        lines = [",".join(line.split(",")[1:]) for line in lines]
    elif way == 5:
        lines[0] = ",".join(rng.permutation(np.array(lines[0].split(","))).tolist())
    elif way == 6:
        lines = [line.replace(",", ";").replace(".", ",") for line in lines]
    elif way == 7:
        jump = float(10.0 ** rng.uniform(-4, 15))
        lines[at:] = [
            f"{_number(line.split(',')[0]) + jump!r},{','.join(line.split(',')[1:])}" for line in lines[at:]
        ]
    elif way == 8:
        lines.insert(at, lines[at])
    else:
        lines = lines[: int(rng.integers(0, 80))]
    return "\n".join(lines)


def _number(text):
    try:
        return float(text)
    except ValueError:
        return 0.0


def damage_columns(columns, rng):
    """Arrays of a wrong kind, shape, length or size."""
    name = list(columns)[int(rng.integers(len(columns)))]
    x = np.asarray(columns[name])
    odd = np.array(x, dtype=complex if np.iscomplexobj(x) else float)
    odd[int(rng.integers(x.size))] = [np.nan, np.inf, 1e300, -1e-320, 0.0][int(rng.integers(5))]
    ways = [
        x[: int(rng.integers(x.size))], x.reshape(-1, 2) if x.size % 2 == 0 else x, x[None, None], np.array(3.0), np.array([]),
        x.astype(str), x.real.astype(np.float16), x.real.astype(np.int8), x.real > 0, x * 1j, odd, np.full(x.shape, np.nan),
        np.zeros(x.shape), x * 1e300, x[::-1], np.array([{"a": 1}] * 3, dtype=object), np.concatenate([x, x]),
        np.zeros(x.size, dtype=[("a", float)]), x.real.astype("datetime64[s]") if False else x.real.astype(">f8"),
    ]  # fmt: skip
    changed = dict(columns)
    changed[name] = ways[int(rng.integers(len(ways)))]
    if rng.random() < 0.15:
        changed = {("x" * 300 if key == name else key): value for key, value in changed.items()}
    if rng.random() < 0.15:
        del changed[next(iter(changed))]
    return changed


def damage(folder, rng):
    """Damage a campaign in place, in one to three ways; returns what was touched."""
    touched = []
    for _ in range(int(rng.integers(1, 4))):
        files = sorted(path for path in folder.iterdir() if path.is_file())
        toml = folder / "campaign.toml"
        path = toml if rng.random() < 0.45 and toml in files else files[int(rng.integers(len(files)))]
        touched.append(path.name)
        data = path.read_bytes()
        plain = rng.random() < 0.4
        try:
            if path.suffix == ".toml" and not plain:
                path.write_text(damage_toml(data.decode(), rng), encoding="utf-8", errors="surrogatepass")
            elif path.suffix == ".csv" and not plain:
                path.write_text(damage_csv(data.decode(), rng), encoding="utf-8", newline="")
            elif path.suffix == ".npz" and not plain:
                with np.load(io.BytesIO(data)) as held:
                    columns = {key: held[key] for key in held}
                np.savez(path, **damage_columns(columns, rng))
            elif path.suffix == ".h5" and not plain:
                _damage_h5(path, rng)
            else:
                path.write_bytes(damage_bytes(data, rng))
        except Exception:  # an earlier damage left nothing to change
            path.write_bytes(damage_bytes(data, rng))
    return touched


def _damage_h5(path, rng):
    with h5py.File(path, "r") as file:
        columns = {key: file[key][()] for key in file}
    changed = damage_columns(columns, rng)
    with h5py.File(path, "w") as file:
        for name, values in changed.items():
            if values.dtype.kind in "OU":
                file.create_dataset(name, data=[str(value) for value in values.ravel()])
            else:
                file.create_dataset(name, data=values)
        name = next(iter(changed), "acc")
        way = int(rng.integers(6))
        if way == 0 and name in file:
            del file[name]
            file[name] = h5py.SoftLink("/nowhere")
        elif way == 1 and name in file:
            del file[name]
            file[name] = h5py.ExternalLink("nowhere.h5", "/x")
        elif way == 2:
            file.create_group("group")["loop"] = h5py.SoftLink("/group")
        elif way == 3 and name in file:
            file[name].attrs["sampling_rate"] = [float("nan"), 1e300, 0.0, 1024.0][int(rng.integers(4))]
        elif way == 4 and name in file:
            del file[name]
            file.create_dataset(name, shape=(10**12,), dtype=float, chunks=(1024,))
