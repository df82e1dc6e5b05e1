// One ray for each pixel of the view, through its centre and the pupil's, straight to the screen: while things move.
// A ray keeps to the dome over which it comes to the array: which neighbour it meets or is blocked by beyond the seam
// concerns few rays, and to ask for it takes a third of the time.
#define GLANCE
precision highp float;
precision highp int;

#include "look.glsl"
#ifdef EMITS
#include "srgb.glsl"
#endif

out vec4 colour;

void main() {
  colour = vec4(vec3(0.0), 1.0);
  vec2 pixel;
  if (look(eye_ray(vec2(view_pixel(gl_FragCoord.xy)) + 0.5, vec2(0.0), NEAREST_FACE), pixel)) {
    colour.rgb = value_at(pixel);
#ifdef EMITS
    colour.rgb = encode(emitted(pixel, decode(colour.rgb)));
#endif
  }
}
