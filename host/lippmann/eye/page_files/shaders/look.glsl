// Traces a ray from the eye through the lenslets to the panel.

#include "lattice.glsl"
#include "dome.glsl"
#include "flat.glsl"
#include "exact.glsl"
#include "eye.glsl"
#include "panel.glsl"

uniform bool crosstalk;  // whether the eye sees pixels that the lenslet does not own
uniform float share;     // position of the array, as a fraction of the distance from panel to the eye of convergence
uniform vec2 axis;       // point in front of which this eye is, array's frame

#ifdef PLANO_TO_PANEL
#define NEAREST_FACE 0.0
#else
#define NEAREST_FACE thickness
#endif

// Returns the pixel coordinates where a ray from the eye ends; the ray's point is on the viewer's face. False is black.
bool look(Ray ray, out vec2 pixel) {
  ray.way.xy = array_from_panel_way(ray.way.xy);
  vec2 point = array_from_panel(ray.point.xy);
  vec2 centre = centre_of(locate(point));
  ray.point.xy = point - centre;
  Landing landing;
  bool seen = reach_panel(ray, landing);
  centre += landing.centre;
  seen = seen && present(centre);
  if (!crosstalk) seen = seen && holds(landing.point * (1.0 - share) - (centre - axis) * share);
  pixel = pixel_from_panel(panel_from_array(centre + landing.point));
  return seen && on_panel(pixel);
}
