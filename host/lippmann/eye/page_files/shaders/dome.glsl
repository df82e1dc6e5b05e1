// Intersection with the domes and refraction there: optics/faces.py, which derives the formulas.
// Lens-local, the vertex at the origin, the dome bulging to +z, glass below.

uniform float curvature;  // 1 / R
uniform float sag;        // depth of a cell's corners

const int MAX_CELLS = 16;

struct Ray {
  vec3 point;
  vec3 way;  // unit
};

struct Crossing {
  vec3 point;    // on the dome, local to the lenslet met
  vec2 centre;   // of that lenslet, from the one that the ray was local to
  float cosine;  // between ray and normal
};

// Meets the sphere that the ray is local to; `t` counts from the ray's point. Perpendicular-foot form.
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

// Negative in the glass, positive in the air; lens-local.
float height(vec3 at) {
  return curvature * dot(at, at) + 2.0 * at.z;
}

// The first dome met, whichever lenslet owns it. False: none within MAX_CELLS.
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
    // Through the wall between two domes: the glass ends there, or begins.
    float wall = height(ray.point + t_flat * ray.way - vec3(step_to, 0.0));
    if (!found && (upward ? wall > 0.0 : wall < 0.0)) break;
#endif
    ray.point.xy -= step_to;
    met.centre += step_to;
  }
  return found;
#endif
}

// Snell's law at the sphere. False: totally reflected.
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
    // This cell's cap, entered from the side: the other root. The dome just left cannot be met again.
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
