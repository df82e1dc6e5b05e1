// Shows the mean light of each pixel's rays, encoded for the screen.
precision highp float;

#include "srgb.glsl"

uniform highp sampler2D light;  // sums of light; alpha is the number of rays

out vec4 colour;

void main() {
  vec4 total = texelFetch(light, ivec2(gl_FragCoord.xy), 0);
  colour = vec4(encode(total.rgb / total.a), 1.0);
}
