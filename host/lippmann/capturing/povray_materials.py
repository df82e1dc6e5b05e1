"""Mitsuba's materials as POV-Ray's textures.

**Factors.** A diffuse surface in Mitsuba has the radiance a / pi times the irradiance E = I cos / d^2 of a point light
of intensity I. In POV-Ray, `diffuse 1` has the radiance a c cos for a light of colour c, times 2 / (1 + (d / f)^2) with
`fade_power 2` and `fade_distance f`, which is 2 f^2 / d^2 for small f. Both agree when c = I / (2 pi f^2), as
`povray.scene` writes it, to a relative f^2 / d^2: a millionth at 1 mm.

The diffuse part of a smooth plastic is a (1 - F(i)) (1 - F(o)) / (eta^2 (1 - Fdr)) in Mitsuba, with the Fresnel
reflectances F of both directions. POV-Ray has no such factors; those of normal incidence are used, which are accurate
to 2 % up to 50 degrees and too bright beyond. The specular reflection follows Fresnel exactly.
"""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from lippmann.base.variant import mitsuba
from lippmann.capturing.povray_source import Item
from lippmann.capturing.povray_text import block, identifier, number, plain, vector
from lippmann.scenes.placement import Triple

SUBSET = "use diffuse, plastic, conductor (a mirror) or dielectric, two-sided or not"


class Side(NamedTuple):
    """Appearance of one side of a surface: its finish, and its pigments for a mesh and for a sphere.

    The pigments differ for an image texture only.
    """

    pigment: str
    sphere: str
    finish: str


@dataclass(frozen=True)
class Material:
    """A material: both sides, and the enclosed refractive index (None: opaque, without Fresnel reflection)."""

    name: str
    front: Side
    back: Side
    index: float | None = None

    @property
    def clear(self) -> bool:
        """Whether light passes."""
        return self.front.pigment == CLEAR

    @property
    def pictures(self) -> bool:
        """Whether it has an image texture."""
        return any(side.pigment != side.sphere for side in (self.front, self.back))

    def declarations(self, spherical: bool) -> dict[str, str]:
        """Return the textures of front and back by name, for a sphere, or for a mesh with uv."""
        stem = f"{self.name}_sphere" if spherical and self.pictures else self.name
        sides = {stem: self.front} if self.back == self.front else {stem: self.front, f"{stem}_back": self.back}
        return {
            name: block(
                "texture", side.sphere if spherical else side.pigment, block("finish", "ambient 0 " + side.finish)
            )
            for name, side in sides.items()
        }


def _plain(colour: Triple, finish: str) -> Side:
    pigment = block("pigment", f"rgb {vector(colour)}")
    return Side(pigment, pigment, finish)


WHITE = (1.0, 1.0, 1.0)
BLACK = _plain((0.0, 0.0, 0.0), "diffuse 0")
CLEAR = block("pigment", "rgbt <1, 1, 1, 1>")


class Materials:
    """Reads each material once, and copies its image textures into the exported folder."""

    def __init__(self, folder: Path) -> None:
        self._mi = mitsuba()
        self._folder = folder
        self._known: dict[int, Material] = {}
        self._pictures: dict[tuple[Path, bool], str] = {}

    def read(self, item: Item) -> Material:
        """Return the material of a BSDF; InputError names the part that POV-Ray cannot express."""
        if item.index not in self._known:
            name = identifier("material", len(self._known), item.id)
            if item.plugin == "twosided":
                (front, index), *others = [self._one(inner) for inner in item.children()]
                item.refuse_leftovers()
                back = others[-1][0] if others else front
            else:
                front, index = self._one(item)
                back = front if front.pigment == CLEAR else BLACK
            self._known[item.index] = Material(name, front, back, index)
        return self._known[item.index]

    def _one(self, item: Item) -> tuple[Side, float | None]:
        """Return the look of a material's front, and the index of what it encloses."""
        index = None
        match item.plugin:
            case "diffuse":
                side = self._coloured(item, "reflectance", "diffuse 1")
            case "conductor":
                if item.value("material", "Cu") != "none" or item.has("eta") or item.has("k"):
                    raise item.refusal("has a complex index", "give material none and a specular_reflectance")
                tint = item.triple("specular_reflectance", WHITE)
                side = _plain((0.0, 0.0, 0.0), f"diffuse 0 reflection {{ rgb {vector(tint)} }}")
            case "dielectric":
                for name in ("specular_reflectance", "specular_transmittance"):
                    if item.triple(name, WHITE) != WHITE:
                        raise item.refusal(f"has a {name} other than 1", "leave it out: clear glass")
                side = Side(CLEAR, CLEAR, "diffuse 0 reflection { 0, 1 fresnel on } conserve_energy")
                index = self._index(item, "bk7")
            case "plastic":
                if item.value("nonlinear", False):
                    raise item.refusal("is nonlinear", "leave nonlinear out")
                tint = item.triple("specular_reflectance", WHITE)
                index = self._index(item, "1.49")
                normal = ((index - 1.0) / (index + 1.0)) ** 2
                inner = float(self._mi.fresnel_diffuse_reflectance(1.0 / index)[0])
                diffuse = (1.0 - normal) ** 2 / (index**2 * (1.0 - inner))
                finish = f"diffuse {number(diffuse)} reflection {{ rgb 0, rgb {vector(tint)} fresnel on }}"
                side = self._coloured(item, "diffuse_reflectance", finish)
            case _:
                raise item.refusal("has no counterpart in POV-Ray", SUBSET)
        item.refuse_leftovers()
        return side, index

    def _index(self, item: Item, default: str) -> float:
        """Return the relative index, by default Mitsuba's; it looks up names in its own table of materials."""
        given: dict[str, float | str] = {"int_ior": item.value("int_ior", default)}
        given["ext_ior"] = item.value("ext_ior", "air")
        for name, value in given.items():
            with contextlib.suppress(ValueError):  # the name of a material
                given[name] = float(value)
        try:
            glass = self._mi.load_dict({"type": "dielectric", **given})
        except Exception as error:  # Mitsuba's errors have no common base
            raise item.refusal(f"has an unknown index ({' '.join(str(error).split())[:100]})", "give it") from None
        return float(self._mi.traverse(glass)["eta"])

    def _coloured(self, item: Item, name: str, finish: str) -> Side:
        """Return a side with the colour or the picture that a property gives."""
        texture = item.child(name)
        if texture is None:
            return _plain(item.triple(name, (0.5, 0.5, 0.5)), finish)
        if texture.plugin != "bitmap":
            raise texture.refusal("has no counterpart", "use a colour or a bitmap")
        if texture.value("wrap_mode", "repeat") != "repeat":
            raise texture.refusal("has a wrap_mode other than repeat", "leave it out")
        interpolate = " interpolate 2" if texture.value("filter_type", "bilinear") == "bilinear" else ""
        raw = texture.value("raw", False)
        file = self._picture(texture, raw)
        texture.refuse_leftovers()
        image = f'png "{file}" gamma {"1.0" if raw else "srgb"} map_type'
        mesh, sphere = (block("image_map", f"{image} {shape}{interpolate}") for shape in (0, 1))
        # Longitude is about z in Mitsuba, about y in POV-Ray.
        sphere = block("pigment", f"{sphere} matrix <1, 0, 0, 0, 0, 1, 0, 1, 0, 0, 0, 0>")
        return Side(f"uv_mapping {block('pigment', mesh)}", sphere, finish)

    def _picture(self, texture: Item, raw: bool) -> str:
        """Copy an image texture as an 8-bit PNG; return its name in the exported folder."""
        path = texture.path("filename")
        key = (path.resolve(), raw)
        if key not in self._pictures:
            try:
                bitmap = self._mi.Bitmap(str(path))
            except Exception as error:  # as above
                raise texture.refusal(f"cannot be read ({' '.join(str(error).split())[:200]})", "mend it") from None
            if bitmap.component_format() != self._mi.Struct.Type.UInt8:
                raise texture.refusal("has more than 8 bits a colour", "save it as an 8-bit PNG")
            name = f"{plain(path.stem)}-{len(self._pictures)}.png"
            bitmap = bitmap.convert(self._mi.Bitmap.PixelFormat.RGB, self._mi.Struct.Type.UInt8, bitmap.srgb_gamma())
            bitmap.write(str(self._folder / name))
            self._pictures[key] = name
        return self._pictures[key]
