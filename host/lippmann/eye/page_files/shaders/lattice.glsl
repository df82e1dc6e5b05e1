// Finds the lenslet of a point, as optics/lattice.py, in the array's frame, mm.

uniform vec2 pitch;   // x: pitch within a row; y: pitch that determines the distance of rows
uniform float shear;
uniform float slant;  // pitch.x / pitch.y
uniform vec2 ends;    // maximum distance of existing lenslets' centres from the origin, along and across rows

const float HALF_SQRT3 = 0.8660254037844386;
// Distance to the crossing for a line that is parallel to a flat.
const float ALONG = 3.0e38;

// Centre of lenslet (i, j).
vec2 centre_of(vec2 lenslet) {
#ifdef HEX
  vec2 centre = pitch * vec2(lenslet.x + 0.5 * lenslet.y, HALF_SQRT3 * lenslet.y);
#else
  vec2 centre = pitch * lenslet;
#endif
  return vec2(centre.x + shear * centre.y, centre.y);
}

// Whether the array has a lenslet with this centre. Beside the array the mount is opaque.
bool present(vec2 centre) {
  return all(lessThanEqual(abs(vec2(centre.x - shear * centre.y, centre.y)), ends));
}

// Returns a vector across a side of a cell. Its dot product with a point of that side is half of pitch.x.
vec2 across(vec2 regular) {
  return vec2(regular.x, regular.y * slant - regular.x * shear);
}

// Returns the lenslet (i, j) that owns a point, as whole numbers.
vec2 locate(vec2 point) {
  point.x -= shear * point.y;
#ifdef HEX
  // Finds the lattice parallelogram that contains the point, then the nearest of its four corners.
  vec2 u = point / vec2(pitch.x, HALF_SQRT3 * pitch.y);
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

// Whether a point, relative to a lenslet's centre, is in the lenslet's cell. Cells are half-open: a point has one owner.
bool holds(vec2 point) {
  float half_pitch = 0.5 * pitch.x;
  float first = dot(across(vec2(1.0, 0.0)), point);
#ifdef HEX
  vec3 q = vec3(first, dot(across(vec2(0.5, HALF_SQRT3)), point), dot(across(vec2(-0.5, HALF_SQRT3)), point));
  return all(greaterThanEqual(q, vec3(-half_pitch))) && all(lessThan(q, vec3(half_pitch)));
#else
  vec2 q = vec2(first, dot(across(vec2(0.0, 1.0)), point));
  return all(greaterThanEqual(q, vec2(-half_pitch))) && all(lessThan(q, vec2(half_pitch)));
#endif
}

// Tests one pair of flats; keeps the first flat that the line crosses, and the centre of the neighbour beyond it.
void cross_flats(vec2 regular, vec2 neighbour, vec2 point, vec2 way, inout float t, inout vec2 step_to) {
  float q = dot(across(regular), point), v = dot(across(regular), way);
  float side = v < 0.0 ? -1.0 : 1.0;
  float here = abs(v) < 1e-30 ? ALONG : (side * 0.5 * pitch.x - q) / v;
  step_to = here < t ? side * centre_of(neighbour) : step_to;
  t = min(t, here);
}

// Returns t where the line point + t way leaves the cell around the origin, and the neighbour's centre.
float leave(vec2 point, vec2 way, out vec2 step_to) {
  float t = ALONG;
  step_to = vec2(0.0);
  cross_flats(vec2(1.0, 0.0), vec2(1.0, 0.0), point, way, t, step_to);
#ifdef HEX
  cross_flats(vec2(0.5, HALF_SQRT3), vec2(0.0, 1.0), point, way, t, step_to);
  cross_flats(vec2(-0.5, HALF_SQRT3), vec2(-1.0, 1.0), point, way, t, step_to);
#else
  cross_flats(vec2(0.0, 1.0), vec2(0.0, 1.0), point, way, t, step_to);
#endif
  return t;
}
