"""What independent programs read of the scenes in a folder, for the suite to compare with what was written.

    python readers.py FOLDER

Every `*.ply` is read with plyfile and with gsply, every `*.spz` with gsply. What a reader found
lies beside the file as `FILE.READER.f32`: its columns one after the other, little-endian f32. Names of the columns, and versions of the
readers, go to standard output as JSON.
"""

import importlib.metadata
import json
import pathlib
import sys

import gsply
import numpy
import plyfile

PLAIN = ["x", "y", "z", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3", "opacity", "f_dc_0", "f_dc_1", "f_dc_2"]


def keep(path, reader, columns):
    """Writes the columns of a file and returns their names."""
    values = [numpy.asarray(column, dtype="<f4").ravel() for column in columns.values()]
    numpy.concatenate(values).tofile(f"{path}.{reader}.f32")
    return list(columns)


def with_plyfile(path):
    vertices = plyfile.PlyData.read(str(path))["vertex"]
    return {prop.name: vertices[prop.name] for prop in vertices.properties}


def with_gsply(data):
    table = [data.means, data.scales, data.quats, numpy.reshape(data.opacities, (-1, 1)), numpy.reshape(data.sh0, (-1, 3))]
    table = numpy.concatenate(table, axis=1)
    return {name: table[:, k] for k, name in enumerate(PLAIN)}


def main():
    folder = pathlib.Path(sys.argv[1])
    found = {}
    for path in sorted(folder.rglob("*.ply")):
        found[str(path.relative_to(folder))] = {
            "plyfile": keep(path, "plyfile", with_plyfile(path)),
            "gsply": keep(path, "gsply", with_gsply(gsply.plyread(str(path)))),
        }
    for path in sorted(folder.rglob("*.spz")):
        found[str(path.relative_to(folder))] = {"gsply": keep(path, "gsply", with_gsply(gsply.read_spz(str(path))))}
    versions = {name: importlib.metadata.version(name) for name in ["plyfile", "gsply"]}
    print(json.dumps({"versions": versions, "files": found}))


main()
