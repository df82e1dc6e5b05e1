// Which lenslet a point belongs to: optics/lattice.py, the array's frame, mm.

uniform float pitch;

const float HALF_SQRT3 = 0.8660254037844386;
// Where a line that runs along a flat crosses it.
const float ALONG = 3.0e38;

// Centre of lenslet (i, j).
vec2 centre_of(vec2 lenslet) {
#ifdef HEX
  return pitch * vec2(lenslet.x + 0.5 * lenslet.y, HALF_SQRT3 * lenslet.y);
#else
  return pitch * lenslet;
#endif
}

// The owner (i, j) of a point, in whole numbers.
vec2 locate(vec2 point) {
#ifdef HEX
  // Corner of the lattice parallelogram that holds the point, then the nearest of its four corners.
  vec2 u = point / vec2(pitch, HALF_SQRT3 * pitch);
  vec2 st = vec2(u.x - 0.5 * u.y, u.y);
  vec2 corner = floor(st);
  st -= corner;
  float q0 = u.x - (corner.x + 0.5 * corner.y);
  float q1 = 0.5 * st.x + st.y;
  bool near = q0 < 0.5 && q1 < 0.5;
  bool far = q0 >= 1.0 && q1 >= 1.0;
  bool right = st.y < st.x;
  return corner + vec2(!near && (far || right), !near && (far || !right));
#else
  return floor(point / pitch + 0.5);
#endif
}

// Whether a point, measured from a lenslet's centre, lies in its cell; half-open, so that each point has one owner.
bool holds(vec2 point) {
  float half_pitch = 0.5 * pitch;
#ifdef HEX
  vec3 q = vec3(point.x, dot(vec2(0.5, HALF_SQRT3), point), dot(vec2(-0.5, HALF_SQRT3), point));
  return all(greaterThanEqual(q, vec3(-half_pitch))) && all(lessThan(q, vec3(half_pitch)));
#else
  return all(greaterThanEqual(point, vec2(-half_pitch))) && all(lessThan(point, vec2(half_pitch)));
#endif
}

// One pair of flats across a direction: keeps the first that the line crosses, and the neighbour's centre there.
void cross_flats(vec2 across, vec2 point, vec2 way, inout float t, inout vec2 step_to) {
  float q = dot(across, point), v = dot(across, way);
  float side = v < 0.0 ? -1.0 : 1.0;
  float here = abs(v) < 1e-30 ? ALONG : (side * 0.5 * pitch - q) / v;
  step_to = here < t ? side * pitch * across : step_to;
  t = min(t, here);
}

// Where the line point + t way leaves the cell round the origin, and from there the neighbour's centre.
float leave(vec2 point, vec2 way, out vec2 step_to) {
  float t = ALONG;
  step_to = vec2(0.0);
  cross_flats(vec2(1.0, 0.0), point, way, t, step_to);
#ifdef HEX
  cross_flats(vec2(0.5, HALF_SQRT3), point, way, t, step_to);
  cross_flats(vec2(-0.5, HALF_SQRT3), point, way, t, step_to);
#else
  cross_flats(vec2(0.0, 1.0), point, way, t, step_to);
#endif
  return t;
}
