// Refraction at the flat face: optics/faces.py. False: totally reflected. `ratio` is index before over index behind.
bool refract_flat(inout vec3 way, float ratio) {
  way.xy *= ratio;
  float across = length(way.xy);
  float square = (1.0 - across) * (1.0 + across);
  way.z = (way.z < 0.0 ? -1.0 : 1.0) * sqrt(max(square, 0.0));
  return square > 0.0;
}
