"""Puts the RTL, and the C++ of its simulations, into the wheel and the source archive (pyproject.toml)."""

from __future__ import annotations

from pathlib import Path

from setuptools.command.build_py import build_py

#: Patterns of the checkout's files that an installed package needs.
CARRIED = ("rtl/*", "rtl/*/*", "rtl/board/*/*", "sim/batch/*", "sim/board/*")
#: The folder of these files in the package, as `lippmann.simulation.toolchain.hardware` returns it. setuptools imports
#: this file without the package, so the name is written twice.
INSTALLED = "hardware"
#: Files that build a wheel from a source archive: this file and its package.
BUILDER = ("host/tools/__init__.py", "host/tools/wheel.py")


def carried() -> list[str]:
    """Return the files' paths relative to the checkout, which is the working directory during a build."""
    return sorted(str(path) for pattern in CARRIED for path in Path().glob(pattern) if path.is_file())


class BuildPy(build_py):  # type: ignore[misc]
    """The setuptools command with the RTL's files after the package's own files."""

    def run(self) -> None:
        """Copy the package, then the RTL. An editable installation uses the RTL of the checkout."""
        super().run()
        for source, target in self._pairs():
            self.mkpath(str(Path(target).parent))
            self.copy_file(source, target)

    def get_source_files(self) -> list[str]:
        """Return the files of a source archive."""
        return [*super().get_source_files(), *carried(), *BUILDER]

    def get_outputs(self, include_bytecode: bool = True) -> list[str]:
        """Return the paths of the files that this command makes."""
        return [*super().get_outputs(include_bytecode), *(target for _, target in self._pairs())]

    def _pairs(self) -> list[tuple[str, str]]:
        if self.editable_mode:
            return []
        place = Path(self.build_lib, "lippmann", INSTALLED)
        return [(source, str(place / source)) for source in carried()]
