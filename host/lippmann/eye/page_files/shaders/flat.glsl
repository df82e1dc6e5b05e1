// Refracts a ray at the flat face, as optics/faces.py. Returns false for total internal reflection. `ratio` is the index
// before the face divided by the index behind the face.
bool refract_flat(inout vec3 way, float ratio) {
  way.xy *= ratio;
  float across = length(way.xy);
  float square = (1.0 - across) * (1.0 + across);
  way.z = (way.z < 0.0 ? -1.0 : 1.0) * sqrt(max(square, 0.0));
  return square > 0.0;
}
