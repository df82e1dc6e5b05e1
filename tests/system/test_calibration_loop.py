"""A board shows the patterns, a simulated camera photographs its video, and a board for what was found is right."""

import numpy as np
import pytest
from lippmann.base.images import write_picture
from lippmann.base.tones import decode, encoded_values, psnr_db
from lippmann.board.board import check_rays
from lippmann.board.streaming import send_frame
from lippmann.board.virtual_loop import capturing
from lippmann.calibration.check import rings
from lippmann.calibration.coded_patterns import PatternSet, write_patterns
from lippmann.calibration.simulated_photographs import photograph_folder
from lippmann.calibration.solve import calibrate
from lippmann.eye.observer import Eye, observe, whole_window
from tools.calibration_accuracy import judge, random_case
from tools.fixed_errors import compare, frame_words, stated_nm

#: Photographs' width for each pixel of the panel.
SHARPNESS = 25 / 16


@pytest.mark.full
@pytest.mark.parametrize("seed", [0, 3])
def test_a_board_is_calibrated_and_then_right(seed, tmp_path):
    case = random_case(seed, 320, round(320 * SHARPNESS))
    display, built, panel = case.nominal, case.built, case.nominal.panel
    patterns = PatternSet.of(display)
    files = write_patterns(patterns, display, tmp_path / "patterns")
    wanted = [patterns.panel_values(one, display) for one in patterns.patterns]
    with capturing(display) as captured:
        for frame in wanted:
            send_frame(captured.board, frame)
            captured.board.panel_crc()  # once a whole frame was scanned out
    shown = captured.frames[-len(wanted) :]
    assert all(np.array_equal(one, other) for one, other in zip(shown, wanted, strict=True))

    # What the board scanned out is what the camera sees.
    folder = tmp_path / "shown"
    folder.mkdir()
    for path, frame in zip(files, shown, strict=True):
        write_picture(folder / path.name, decode(frame / 255.0, panel.transfer), {}, panel.transfer, 8)
    photographs = tmp_path / "photographs"
    for number, camera in enumerate(case.cameras, 1):
        photograph_folder(built, camera, folder, photographs / f"position-{number}", seed + number, case.sensor)
    (photographs / "patterns.toml").write_bytes((tmp_path / "patterns/patterns.toml").read_bytes())
    found = calibrate(photographs, display).display
    assert judge(found, built).rms_px < 0.1

    picture = encoded_values(rings(found), panel.transfer, 8).astype(np.uint8)
    with capturing(found) as again:
        check = check_rays(again.board, found, (0, panel.width_px - 1), (0, panel.height_px - 1))
        build = again.board.optics_build()
        send_frame(again.board, picture)
        again.board.panel_crc()
    assert check.equal, "the registers' rays are not the twin's"
    assert check.rays == panel.width_px * panel.height_px
    assert np.array_equal(again.frames[-1], picture)
    for words in frame_words(found, build, 1, panel.width_px * panel.height_px):
        near = compare(found, build, words)
        assert not near.status_differs.sum() > 1e-3 * len(near.alive)
        # The widest promises 1 microradian and 2 nm, and each bit less doubles both.
        bound = stated_nm(build.fraction_bits)
        assert (near.turn_urad * near.weight)[near.alive].max() < 0.5 * bound
        assert near.shift_nm[near.alive].max() < bound

    # An eye sees the rings as on a display that was built as its file says; before, it saw them broken.
    eye, window = Eye(case.cameras[0].position_mm), whole_window(built)
    seen = {
        name: observe(light, built, eye, window, 64).radiance
        for name, light in (
            ("before", rings(display)),
            ("after", decode(again.frames[-1] / 255.0, panel.transfer)),
            ("ideal", rings(built)),
        )
    }
    after, before = (psnr_db(seen[name], seen["ideal"]) for name in ("after", "before"))
    assert after > before + 10.0, f"{before:.1f} dB before, {after:.1f} dB after"
