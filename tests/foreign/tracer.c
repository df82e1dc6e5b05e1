// SPDX-License-Identifier: Apache-2.0
// A ray tracer of its own, in C, which answers a stream of lippmann vectors (docs/how-to/regress.md).
//
//   cc -O2 -std=c11 -Wall -Wextra -o tracer tracer.c -lm
//   lippmann vectors --display FILE --stream | ./tracer | lippmann regress --stream
//
// It is written from docs/reference/optics.md and shares nothing with lippmann. Convex lenslets, model exact.

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { OK, MISSED, REFLECTED, BLOCKED, CROSSTALK, MOST_CELLS = 16 };

static struct {
  double width, height, pixel_x, pixel_y;                 // panel, pixels and mm
  double px, py, row, shear, turn, offset_x, offset_y;    // lattice; row: 1, or sqrt(3)/2 between rows
  double extent_x, extent_y, R, n, T, gap, sag, depth;    // depth: D, panel to aperture plane
  double eye, eye_x, eye_y;                               // eye: its distance, 0 for none
  int hex, plano_to_panel;
} display;

typedef struct { double p[3], d[3]; } Ray;  // from a lenslet's vertex, the domes to +z
typedef struct { double i, j; } Cell;

static double dot(const double a[3], const double b[3]) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static void centre(Cell c, double *x, double *y) {
  double v = c.j * display.row;
  *y = display.py * v;
  *x = display.px * (c.i + (display.hex ? 0.5 * c.j : 0.0)) + display.shear * *y;
}

// The cell's directions on the regular lattice of pitch 1: a point is inside when -1/2 <= q_k < 1/2.
static int sides(double x, double y, double q[3]) {
  double v = y / display.py, u = (x - display.shear * y) / display.px;
  q[0] = u;
  q[1] = display.hex ? 0.5 * u + sqrt(0.75) * v : v;
  q[2] = sqrt(0.75) * v - 0.5 * u;
  return display.hex ? 3 : 2;
}

// The step over side k of a cell, in lenslets.
static Cell over(int k, double sign) {
  static const Cell hex[] = {{1, 0}, {0, 1}, {-1, 1}}, square[] = {{1, 0}, {0, 1}};
  Cell c = display.hex ? hex[k] : square[k];
  return (Cell){sign * c.i, sign * c.j};
}

// The cell that owns a point; the point becomes local to it.
static Cell owner(double *x, double *y) {
  double v = *y / display.py, u = (*x - display.shear * *y) / display.px;
  Cell c = {0.0, floor(v / display.row + 0.5)};
  c.i = floor(u - (display.hex ? 0.5 * c.j : 0.0) + 0.5);
  double cx, cy, q[3];
  for (int round = 0; round < 4; round++) {  // on hexagons the guess may be a neighbour
    centre(c, &cx, &cy);
    int count = sides(*x - cx, *y - cy, q), moved = 0;
    for (int k = 0; k < count && !moved; k++)
      if (q[k] < -0.5 || q[k] >= 0.5) {
        Cell step = over(k, q[k] < 0 ? -1 : 1);
        c.i += step.i, c.j += step.j, moved = 1;
      }
    if (!moved) break;
  }
  centre(c, &cx, &cy);
  *x -= cx, *y -= cy;
  return c;
}

// Where a line meets the dome's sphere around (0, 0, -R): the two distances; 0 when it does not. p is moved to the foot
// of the perpendicular from the vertex first, which keeps the digits of far points.
static int sphere(const Ray *ray, double t[2]) {
  double foot = -dot(ray->p, ray->d), p[3];
  for (int k = 0; k < 3; k++) p[k] = ray->p[k] + foot * ray->d[k];
  double b = display.R * ray->d[2], c = dot(p, p) + 2.0 * display.R * p[2], root = b * b - c;
  if (root < 0.0) return 0;
  double far = -b - copysign(sqrt(root), b), near = far == 0.0 ? 0.0 : c / far;
  t[0] = foot + fmin(far, near);
  t[1] = foot + fmax(far, near);
  return 1;
}

// Where a ray leaves its cell, from t on, and over which side.
static double leaves(const Ray *ray, double from, Cell *step) {
  double q[3], dq[3], best = INFINITY;
  int count = sides(ray->p[0], ray->p[1], q);
  sides(ray->d[0], ray->d[1], dq);
  for (int k = 0; k < count; k++) {
    if (dq[k] == 0.0) continue;
    double sign = dq[k] > 0 ? 1 : -1, t = (0.5 * sign - q[k]) / dq[k];
    if (t >= from - 1e-12 && t < best) best = t, *step = over(k, sign);
  }
  return best;
}

static void into(Ray *ray, Cell *cell, Cell step) {
  double x, y;
  centre(step, &x, &y);
  ray->p[0] -= x, ray->p[1] -= y;
  cell->i += step.i, cell->j += step.j;
}

// The first point of the domes on a ray's way from t = 0, from the glass (upward) or from the air. 0: none.
static int meet(Ray *ray, Cell *cell, int upward, double *at) {
  double from = 0.0;
  for (int k = 0; k < MOST_CELLS; k++) {
    Cell step = {0, 0};
    double end = leaves(ray, from, &step), t[2];
    int there = sphere(ray, t), inside = there && t[0] <= from && from <= t[1];
    if (k > 0 && upward && !inside) return 0;   // a wall
    if (k > 0 && !upward && inside && from > t[0] + 1e-12) return 0;
    double hit = there ? t[upward] : INFINITY;
    if (there && hit <= end && (upward || hit >= from - 1e-12)) return *at = hit, 1;
    if (!isfinite(end)) return 0;
    from = end;
    into(ray, cell, step);
  }
  return 0;
}

// Whether a ray that left a dome at t = 0 (in the air, or into the glass) comes to a dome again.
static int meets_again(Ray ray, int in_glass) {
  Cell cell = {0, 0};
  double from = 0.0;
  for (int k = 0; k < 64; k++) {
    Cell step = {0, 0};
    double end = leaves(&ray, from, &step), t[2];
    // The layer of the domes ends at the vertices above and at the rims below.
    double last = in_glass ? (-display.sag - ray.p[2]) / ray.d[2] : -ray.p[2] / ray.d[2];
    int there = sphere(&ray, t);
    double stop = fmin(end, last);
    if (in_glass) {
      if (k > 0 && !(there && t[0] <= from && from < t[1])) return 1;
      if (there && t[1] < stop && t[1] > from) return 1;
    } else if (k > 0 && there && t[1] > from && t[0] < stop) {
      return 1;
    }
    if (last <= end) return 0;
    from = end;
    into(&ray, &cell, step);
  }
  return 0;
}

// Snell's law in vectors: from index ratio * n into n, `normal` against the ray; 0: total reflection.
static int refract(double d[3], const double normal[3], double ratio) {
  double c = -dot(d, normal), square = 1.0 - ratio * ratio * (1.0 - c * c);
  if (square <= 0.0) return 0;
  for (int k = 0; k < 3; k++) d[k] = ratio * d[k] + (ratio * c - sqrt(square)) * normal[k];
  return 1;
}

static void go(Ray *ray, double t) {
  for (int k = 0; k < 3; k++) ray->p[k] += t * ray->d[k];
}

static void normal_of(const Ray *ray, double sign, double normal[3]) {
  for (int k = 0; k < 3; k++) normal[k] = sign * (ray->p[k] / display.R + (k == 2));
}

// Through the array, from the near plane; z counted from the vertices, domes to +z.
static int pass(Ray *ray, Cell *cell) {
  double normal[3], t, x, y;
  static const double up[3] = {0, 0, 1}, down[3] = {0, 0, -1};
  if (display.plano_to_panel) {
    if (!refract(ray->d, down, 1.0 / display.n)) return REFLECTED;
    go(ray, (-display.sag - ray->p[2]) / ray->d[2]);
  }
  x = ray->p[0], y = ray->p[1];
  Cell step = owner(&x, &y);
  ray->p[0] = x, ray->p[1] = y;
  cell->i += step.i, cell->j += step.j;
  if (!meet(ray, cell, display.plano_to_panel, &t)) return MISSED;
  go(ray, t);
  normal_of(ray, display.plano_to_panel ? -1 : 1, normal);
  if (!refract(ray->d, normal, display.plano_to_panel ? display.n : 1.0 / display.n)) return REFLECTED;
  if (display.plano_to_panel) return ray->d[2] <= 0.0 || meets_again(*ray, 0) ? BLOCKED : OK;
  if (ray->d[2] >= 0.0 || meets_again(*ray, 1)) return BLOCKED;
  go(ray, (-display.T - ray->p[2]) / ray->d[2]);
  return refract(ray->d, up, display.n) ? OK : REFLECTED;
}

static int is_there(Cell c) {
  double x, y;
  if (display.extent_x == 0.0) return 1;
  centre(c, &x, &y);
  return fabs(x - display.shear * y) <= display.extent_x / 2 && fabs(y) <= display.extent_y / 2;
}

static void answer(double u, double v, double a, double b) {
  double c = cos(display.turn), s = sin(display.turn), sx, sy, cx, cy;
  double x = (u - display.width / 2) * display.pixel_x, y = (display.height / 2 - v) * display.pixel_y;
  double X = c * (x - display.offset_x) + s * (y - display.offset_y);
  double Y = c * (y - display.offset_y) - s * (x - display.offset_x);
  sx = X, sy = Y;
  if (display.eye > 0.0) {  // where the line to the eye crosses the aperture plane
    double share = display.depth / (display.depth + display.eye);
    double ex = share * (display.eye_x - x), ey = share * (display.eye_y - y);
    sx += c * ex + s * ey, sy += c * ey - s * ex;
  }
  Cell home = owner(&sx, &sy), cell = home;
  if (!is_there(home)) {
    printf(" %d\n", BLOCKED);
    return;
  }
  centre(home, &cx, &cy);
  X -= cx, Y -= cy;
  Ray ray = {{X, Y, 0}, {a - X, b - Y, display.depth}};
  double length = sqrt(dot(ray.d, ray.d)), share = display.gap / display.depth;
  if (share < 0.5) ray.p[0] += share * (a - X), ray.p[1] += share * (b - Y);
  else ray.p[0] = a - (1.0 - share) * (a - X), ray.p[1] = b - (1.0 - share) * (b - Y);
  for (int k = 0; k < 3; k++) ray.d[k] /= length;
  if (display.plano_to_panel) ray.p[2] = -display.T;
  else ray.d[2] = -ray.d[2];
  int status = pass(&ray, &cell);
  if (!display.plano_to_panel) ray.p[2] = -ray.p[2], ray.d[2] = -ray.d[2];
  if (status != MISSED && !is_there(cell)) status = BLOCKED;
  if (status == OK && (cell.i != home.i || cell.j != home.j)) status = CROSSTALK;
  if (status != OK && status != CROSSTALK) {
    printf(" %d\n", status);
    return;
  }
  centre(cell, &cx, &cy);
  x = ray.p[0] + cx, y = ray.p[1] + cy;
  printf(" %d %.0f %.0f %.17g %.17g %.17g %.17g %.17g %.17g\n", status, cell.i, cell.j,
         display.offset_x + c * x - s * y, display.offset_y + s * x + c * y, ray.p[2],
         c * ray.d[0] - s * ray.d[1], s * ray.d[0] + c * ray.d[1], ray.d[2]);
}

// The numbers that lines "# value NAME NUMBER" give.
static const struct { const char *name; double *to; } VALUES[] = {
  {"width_px", &display.width}, {"height_px", &display.height}, {"pixel_x", &display.pixel_x},
  {"pixel_y", &display.pixel_y}, {"pitch_x", &display.px}, {"pitch_y", &display.py}, {"shear", &display.shear},
  {"rotation", &display.turn}, {"offset_x", &display.offset_x}, {"offset_y", &display.offset_y},
  {"extent_x", &display.extent_x}, {"extent_y", &display.extent_y}, {"radius", &display.R}, {"index", &display.n},
  {"thickness", &display.T}, {"gap", &display.gap}, {"eye_distance", &display.eye}, {"eye_x", &display.eye_x},
  {"eye_y", &display.eye_y},
};

static void value(const char *name, const char *text) {
  for (size_t k = 0; k < sizeof VALUES / sizeof *VALUES; k++)
    if (!strcmp(name, VALUES[k].name)) *VALUES[k].to = strtod(text, NULL);
  if (!strcmp(name, "grid")) display.hex = !strcmp(text, "hex");
  if (!strcmp(name, "plano")) display.plano_to_panel = !strcmp(text, "panel");
}

// What follows from the numbers of a set.
static void complete(void) {
  display.turn *= acos(-1.0) / 180.0;
  display.row = display.hex ? sqrt(0.75) : 1.0;
  double far = 0.0;  // square of the distance to the cell's farthest corner
  for (int k = 0; k < 3; k++) {
    static const double hex[3][2] = {{0.5, 0.28867513459481287}, {0, 0.57735026918962573}, {-0.5, 0.28867513459481287}};
    static const double square[3][2] = {{0.5, 0.5}, {-0.5, 0.5}, {0.5, 0.5}};
    const double *corner = display.hex ? hex[k] : square[k];
    double y = display.py * corner[1], x = display.px * corner[0] + display.shear * y;
    far = fmax(far, x * x + y * y);
  }
  display.sag = far / (display.R + sqrt(fmax(0.0, display.R * display.R - far)));
  display.depth = display.plano_to_panel ? display.gap + display.T / display.n : fmax(display.gap, display.sag);
}

int main(void) {
  char line[4096], name[64], text[64];
  double u, v, a, b;
  while (fgets(line, sizeof line, stdin)) {
    if (line[0] == '#') {
      if (sscanf(line, "# value %63s %63s", name, text) == 2) value(name, text);
      if (!strncmp(line, "# numbers ", 10) && strcmp(line, "# numbers decimal exact\n")) {
        fprintf(stderr, "tracer: it answers numbers of the model exact alone\n");
        return 2;
      }
      if (!strncmp(line, "# rays ", 7)) complete();
      fputs(line, stdout);
    } else if (sscanf(line, "%*d %lf %lf %lf %lf", &u, &v, &a, &b) == 4) {
      line[strcspn(line, "\r\n")] = 0;
      fputs(line, stdout);
      answer(u, v, a, b);
    }
  }
  return 0;
}
