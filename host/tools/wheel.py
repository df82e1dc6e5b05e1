"""Adds the RTL, and the C++ of its simulations, to the wheel and the source archive (pyproject.toml)."""

from __future__ import annotations

from pathlib import Path

from setuptools.command.build_py import build_py

#: Patterns of those files of the checkout that an installed package needs.
CARRIED = ("rtl/*", "rtl/*/*", "rtl/board/*/*", "sim/batch/*", "sim/board/*")
#: Folder of the RTL in the installed package, which `lippmann.simulation.toolchain.hardware` names too: setuptools
#: imports wheel.py without the package.
INSTALLED = "hardware"
#: Files that a source archive needs to build a wheel: wheel.py and its package.
BUILDER = ("host/tools/__init__.py", "host/tools/wheel.py")


def carried() -> list[str]:
    """Return the paths of the `CARRIED` files in the checkout, which is the working directory of a build."""
    return sorted(str(path) for pattern in CARRIED for path in Path().glob(pattern) if path.is_file())


class BuildPy(build_py):  # type: ignore[misc]
    """The setuptools command that copies the package, and then the RTL's files."""

    def run(self) -> None:
        """Copy the package, then the RTL. An editable installation uses the RTL of the checkout."""
        super().run()
        for source, target in self._pairs():
            self.mkpath(str(Path(target).parent))
            self.copy_file(source, target)

    def get_source_files(self) -> list[str]:
        """Return the paths of all files for a source archive."""
        return [*super().get_source_files(), *carried(), *BUILDER]

    def get_outputs(self, include_bytecode: bool = True) -> list[str]:
        """Return the paths of all files that this command writes."""
        return [*super().get_outputs(include_bytecode), *(target for _, target in self._pairs())]

    def _pairs(self) -> list[tuple[str, str]]:
        if self.editable_mode:
            return []
        place = Path(self.build_lib, "lippmann", INSTALLED)
        return [(source, str(place / source)) for source in carried()]
