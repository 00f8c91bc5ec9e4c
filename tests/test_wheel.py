"""The wheel holds every file of the package, not only Python: SWFs, pages, recipes, pictures."""

import subprocess
import sys
import zipfile

from tests.test_architecture import PACKAGE, ROOT


def test_the_wheel_holds_every_file_of_the_package(tmp_path):
    command = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", tmp_path]
    subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
    (wheel,) = tmp_path.iterdir()
    with zipfile.ZipFile(wheel) as packed:
        names = set(packed.namelist())
    files = {path.relative_to(ROOT).as_posix() for path in PACKAGE.rglob("*") if path.is_file()}
    expected = {name for name in files if "__pycache__" not in name}
    assert {".swf", ".toml", ".html", ".js", ".hx", ".yaml"} <= {
        f".{n.split('.')[-1]}" for n in names
    }
    assert expected - names == set()
