// Computes sample points of a view's pixels, as optics/sample_points.py with seed 0. So the page and `lippmann observe`
// trace the same rays.

const vec2 R2_STEPS = vec2(0.7548776662466927, 0.5698402909980532);

// Hashes two numbers to [0, 1) by six rounds of the Tiny Encryption Algorithm (Wheeler and Needham, 1994), as Mitsuba's
// sample_tea_float32.
float hash(uint a, uint b) {
  uint total = 0u;
  for (int k = 0; k < 6; ++k) {
    total += 0x9e3779b9u;
    a += ((b << 4) + 0xa341316cu) ^ (b + total) ^ ((b >> 5) + 0xc8013ea4u);
    b += ((a << 4) + 0xad90777du) ^ (a + total) ^ ((a >> 5) + 0x7e95761eu);
  }
  return uintBitsToFloat((b >> 9) | 0x3f800000u) - 1.0;
}

// Returns point `number` of a pixel in the unit square. Streams are independent.
vec2 point_in_square(uint pixel, uint number, uint stream) {
  vec2 shift = vec2(hash(pixel, 2u * stream * 0x9e3779b9u), hash(pixel, (2u * stream + 1u) * 0x9e3779b9u));
  return min(fract(shift + float(number) * R2_STEPS), vec2(1.0 - exp2(-24.0)));
}

// Returns (cos, sin) of an angle up to pi / 4, to 3e-7 by Taylor's series. A GPU's own functions may be wrong by 5e-4.
vec2 turned(float angle) {
  float q = angle * angle;
  float cosine = 1.0 - q / 2.0 * (1.0 - q / 12.0 * (1.0 - q / 30.0 * (1.0 - q / 56.0)));
  float sine = angle * (1.0 - q / 6.0 * (1.0 - q / 20.0 * (1.0 - q / 42.0 * (1.0 - q / 72.0))));
  return vec2(cosine, sine);
}

// Maps the unit square to the unit disk with equal areas, squares to rings (Shirley and Chiu, 1997).
vec2 square_to_disk(vec2 point) {
  const float QUARTER_PI = 0.7853981633974483;
  vec2 r = 2.0 * point - 1.0;
  if (r.x == 0.0 && r.y == 0.0) return vec2(0.0);
  bool steep = abs(r.x) < abs(r.y);
  float radius = steep ? r.y : r.x;
  vec2 way = turned(QUARTER_PI * (steep ? r.x / r.y : r.y / r.x));
  return radius * (steep ? way.yx : way);
}
