// Draws one ray per pixel of the view, through the pixel's centre and the pupil's centre, on the screen during motion.
// A ray uses only the dome above which it reaches the array. Neighbouring domes concern few rays, and testing them takes
// a third of the time.
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
