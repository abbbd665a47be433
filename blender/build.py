"""Build the extension: `python blender/build.py OUT` writes a zip that Blender installs, for this system.

`--platforms` names others, as runtime/wheels.py does, which compiles for them by ziglang; `all` is all of
them. A zip has the extension, its licence, and the wheel of uvcloth-core, unmodified. Beside the zips comes
index.json: the folder, put on any web server, is a repository that Blender can be subscribed to.
"""

import argparse
import hashlib
import json
import re
import shutil
import sys
import tempfile
import tomllib
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
ROOT, EXTENSION = HERE.parent, HERE / "extension"
sys.path.insert(0, str(ROOT / "runtime"))

from wheels import CORE, TARGETS, build_wheel, copy_core, copy_sources  # noqa: E402

MANIFEST, INDEX = "blender_manifest.toml", "index.json"

ONLY_INSIDE = ("wheels", "build")
"""Entries of a manifest that an index leaves out."""

PLATFORMS = {
    "linux_x86_64": "linux-x64",
    "manylinux_2_17_x86_64": "linux-x64",
    "manylinux_2_17_aarch64": "linux-arm64",
    "macosx_11_0_arm64": "macos-arm64",
    "macosx_11_0_x86_64": "macos-x64",
    "win_amd64": "windows-x64",
}
"""Blender's name of a platform by that in a wheel's name."""

REQUIRED = {
    "schema_version": r"1\.0\.0",
    "id": r"[a-z][a-z0-9_]*",
    "version": r"\d+\.\d+\.\d+",
    "name": r"(?!.*[Bb]lender).+",
    "tagline": r".{1,63}\w",
    "maintainer": r".+",
    "type": "add-on",
    "blender_version_min": r"\d+\.\d+\.\d+",
}
"""Texts that a manifest needs, by the rules of Blender's platform."""

LONGEST_REASON = 64
"""Letters of what a permission is for."""


def require_manifest(manifest: dict[str, Any]) -> None:
    """Raise ValueError for a manifest that the platform would not take."""
    for name, pattern in REQUIRED.items():
        value = manifest.get(name)
        if not isinstance(value, str) or not re.fullmatch(pattern, value):
            raise ValueError(f"{MANIFEST}: {name} is {value!r}, expected {pattern}")
    if manifest.get("license") != ["SPDX:GPL-3.0-or-later"]:
        raise ValueError(f"{MANIFEST}: license is {manifest.get('license')!r}")
    for name, reason in manifest.get("permissions", {}).items():
        if len(reason) > LONGEST_REASON or reason.endswith("."):
            raise ValueError(f"{MANIFEST}: permissions.{name} is {reason!r}, expected a short reason")


def compile_core(platform: str, target: Path) -> Path:
    """Build the wheel of uvcloth-core, for this system if the platform is empty; returns its path."""
    with tempfile.TemporaryDirectory(prefix="uvcloth-extension-") as place:
        source, core = Path(place) / "source", Path(place) / "core"
        copy_sources(source)
        copy_core(source, core)
        objects = Path("build") / "runtime"
        if (ROOT / objects).is_dir():
            # Objects that are of the same sources by their names are not compiled again.
            shutil.copytree(ROOT / objects, core / objects)
        return build_wheel(core, Path(CORE), platform, target)


def build_extension(target: Path, wheel: Path) -> Path:
    """Write the extension with a wheel into a folder; returns the path of the zip.

    Raises ValueError for a manifest that the platform would not take, and for a wheel of another version or
    system.
    """
    text = (EXTENSION / MANIFEST).read_text(encoding="utf-8")
    manifest = tomllib.loads(text)
    require_manifest(manifest)
    version, tag = wheel.stem.split("-")[1], wheel.stem.split("-")[-1]
    if version != manifest["version"]:
        raise ValueError(f"{wheel.name} is of version {version}, the extension {manifest['version']}")
    platform = next((ours for theirs, ours in PLATFORMS.items() if theirs in tag.split(".")), None)
    if platform is None:
        raise ValueError(f"{wheel.name} is for none of {', '.join(PLATFORMS)}")
    added = f'platforms = ["{platform}"]\nwheels = ["./wheels/{wheel.name}"]\n\n[permissions]'
    path = target / f"{manifest['id']}-{version}-{platform.replace('-', '_')}.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for each in sorted(EXTENSION.glob("*.py")):
            archive.write(each, each.name)
        archive.write(HERE / "LICENSE", "LICENSE")
        archive.write(ROOT / "NOTICE", "NOTICE")
        archive.writestr(MANIFEST, text.replace("[permissions]", added))
        archive.write(wheel, f"wheels/{wheel.name}")
    return path


def write_index(folder: Path) -> Path:
    """List the extensions of a folder in its index, as Blender reads it; returns the path.

    Raises ValueError for a zip of another extension.
    """
    entries = []
    for path in sorted(folder.glob("*.zip")):
        content = path.read_bytes()
        with zipfile.ZipFile(path) as archive:
            if MANIFEST not in archive.namelist():
                raise ValueError(f"{path}: has no {MANIFEST}, so {folder} can be no repository")
            manifest = tomllib.loads(archive.read(MANIFEST).decode())
        entries.append(
            {name: value for name, value in manifest.items() if name not in ONLY_INSIDE}
            | {
                "archive_size": len(content),
                "archive_hash": f"sha256:{hashlib.sha256(content).hexdigest()}",
                "archive_url": f"./{path.name}",
            }
        )
    index = folder / INDEX
    text = json.dumps({"version": "v1", "blocklist": [], "data": entries}, indent=2)
    index.write_text(text + "\n", encoding="utf-8")
    return index


def main(target: Path, platforms: Sequence[str]) -> None:
    """Build the extension for platforms, "" for this system, and say what was written."""
    target.mkdir(parents=True, exist_ok=True)
    for platform in TARGETS if list(platforms) == ["all"] else platforms:
        with tempfile.TemporaryDirectory(prefix="uvcloth-wheel-") as place:
            path = build_extension(target, compile_core(platform, Path(place)))
        print(f"{path}  {path.stat().st_size / 1e6:.2f} MB")
    print(write_index(target))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("target", type=Path)
    parser.add_argument("--platforms", nargs="+", default=[""], metavar="PLATFORM")
    arguments = parser.parse_args()
    main(arguments.target, arguments.platforms)
