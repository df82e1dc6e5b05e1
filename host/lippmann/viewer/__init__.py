"""The viewer page: an integral image, its display, and the exact optics in one HTML file that needs nothing else.

`page.html`, `slider.html`, `direct.html`, `depth.svg` and `style.css` are the page, `shaders/` trace the rays (one
file a step, named as in `lippmann.optics`), `scripts/` run it.
"""
