// Intersects rays with the domes and refracts them, by the formulas of optics/faces.py.
// Coordinates are local to a lenslet: the vertex is the origin, the dome bulges to +z, and the glass is below.

uniform float curvature;  // 1 / R
uniform float sag;        // depth of a cell's corners below the vertex

const int MAX_CELLS = 16;

struct Ray {
  vec3 point;
  vec3 way;  // unit
};

struct Crossing {
  vec3 point;    // point on the dome, local to the lenslet that the ray meets
  vec2 centre;   // centre of that lenslet, from the centre of the ray's lenslet
  float cosine;  // cosine of the angle between ray and normal
};

// Intersects the ray with the sphere of its lenslet; `t` is measured from the ray's point. Perpendicular-foot form.
bool meet_cap(Ray ray, bool upward, out float t, out vec3 at, out float cosine) {
  float along = dot(ray.point, ray.way);
  vec3 foot = ray.point - along * ray.way;
  float f = curvature * dot(foot, foot) + 2.0 * foot.z;
  float square = ray.way.z * ray.way.z - curvature * f;
  cosine = sqrt(max(square, 0.0));
  float root = upward ? -f / max(ray.way.z + cosine, 1e-30) : f / max(cosine - ray.way.z, 1e-30);
  at = foot + root * ray.way;
  t = root - along;
  return square >= 0.0;
}

// Returns a height that is negative in the glass and positive in the air, in lens-local coordinates.
float height(vec3 at) {
  return curvature * dot(at, at) + 2.0 * at.z;
}

// Finds the first dome that the ray meets, of any lenslet. Returns false if there is none within MAX_CELLS cells.
bool meet(Ray ray, bool upward, out Crossing met) {
  float t;
  met.centre = vec2(0.0);
#ifdef GLANCE
  return meet_cap(ray, upward, t, met.point, met.cosine);
#else
  bool found = meet_cap(ray, upward, t, met.point, met.cosine) && holds(met.point.xy);
  for (int k = 0; k < MAX_CELLS && !found; ++k) {
    vec2 step_to;
    float t_flat = leave(ray.point.xy, ray.way.xy, step_to);
    found = meet_cap(ray, upward, t, met.point, met.cosine) && t <= t_flat;
    step_to = found ? vec2(0.0) : step_to;
#ifdef STEPPED
    // The ray crosses the wall between two domes, where the glass ends or begins.
    float wall = height(ray.point + t_flat * ray.way - vec3(step_to, 0.0));
    if (!found && (upward ? wall > 0.0 : wall < 0.0)) break;
#endif
    ray.point.xy -= step_to;
    met.centre += step_to;
  }
  return found;
#endif
}

// Applies Snell's law at the sphere. Returns false for total internal reflection.
bool refract_dome(Crossing met, float ratio, bool upward, inout vec3 way) {
  float square = 1.0 - ratio * ratio * (1.0 - met.cosine) * (1.0 + met.cosine);
  float bend = sqrt(max(square, 0.0)) - ratio * met.cosine;
  way = ratio * way + (upward ? bend : -bend) * vec3(curvature * met.point.xy, 1.0 + curvature * met.point.z);
  return square > 0.0;
}

// Whether a ray that left a dome upward through the air meets a neighbour's dome.
bool blocked_above(Ray ray) {
  bool blocked = ray.way.z <= 0.0;
  float t_top = -ray.point.z / max(ray.way.z, 1e-30);
  bool searching = !blocked && !holds(ray.point.xy + t_top * ray.way.xy);
  float t_before = 0.0;
  for (int k = 0; k < MAX_CELLS && searching; ++k) {
    vec2 step_to;
    float t_flat = leave(ray.point.xy, ray.way.xy, step_to);
    float t, cosine;
    vec3 at;
    bool met = meet_cap(ray, true, t, at, cosine);
    // A ray from the side meets this cell's cap at the other root. A ray cannot meet again the dome that it just left.
    t = -(ray.way.z + cosine) / curvature - dot(ray.point, ray.way);
    blocked = met && k > 0 && t > t_before && t <= min(t_flat, t_top);
#ifdef STEPPED
    blocked = blocked || (k > 0 && height(ray.point + t_before * ray.way) < 0.0);
#endif
    searching = !blocked && t_flat < t_top;
    t_before = t_flat;
    ray.point.xy -= step_to;
  }
  return blocked || searching;
}

// Whether a ray that entered a dome downward leaves the glass again through a seam's valley.
bool blocked_below(Ray ray) {
  bool blocked = ray.way.z >= 0.0;
  float t_rim = (-sag - ray.point.z) / min(ray.way.z, -1e-30);
  bool searching = !blocked && !holds(ray.point.xy + t_rim * ray.way.xy);
  float t_before = 0.0;
  for (int k = 0; k < MAX_CELLS && searching; ++k) {
    vec2 step_to;
    float t_flat = leave(ray.point.xy, ray.way.xy, step_to);
    bool deeper = t_flat < t_rim;
    blocked = deeper && height(ray.point + t_flat * ray.way) > 0.0;
#ifdef STEPPED
    blocked = blocked || (k > 0 && height(ray.point + t_before * ray.way) > 0.0);
#endif
    searching = deeper && !blocked;
    t_before = t_flat;
    ray.point.xy -= step_to;
  }
  return blocked || searching;
}
