// Traces one more ray per pixel of the view, and adds its light to the light of the earlier rays.
precision highp float;
precision highp int;

#include "look.glsl"
#include "sampling.glsl"
#include "srgb.glsl"

uniform highp sampler2D light_before;
uniform uint ray_number;

out vec4 light;

void main() {
  uvec2 place = view_pixel(gl_FragCoord.xy);
  uint pixel_number = place.y * window_px.x + place.x;
  vec2 aim = point_in_square(pixel_number, ray_number, 0u);
  vec2 pupil_point = vec2(0.0);
  if (pupil > 0.0) pupil_point = square_to_disk(point_in_square(pixel_number, ray_number, 1u));
  light = vec4(vec3(0.0), 1.0);
  vec2 pixel;
  if (look(eye_ray(vec2(place) + aim, pupil_point, NEAREST_FACE), pixel)) {
    light.rgb = decode(value_at(pixel));
#ifdef EMITS
    light.rgb = emitted(pixel, light.rgb);
#endif
  }
  if (ray_number > 0u) light += texelFetch(light_before, ivec2(gl_FragCoord.xy), 0);
}
