#define _GNU_SOURCE
/* A traffic participant model of OSMP for FMI 2 or 3 (-DFMI=3), with a reader and writer of protocol buffers of its own.
   It follows whom it sees ahead, and gives its state at the end of the step, and two points of its trajectory. */
#if FMI == 3
#include "fmi3Functions.h"
#else
#include "fmi2Functions.h"
#endif
#include <math.h>
#include <stdlib.h>
#include <string.h>

typedef struct { const unsigned char *at, *end; } span;
typedef struct { long id; double x, y, yaw, vx, vy, length; } object;
static double time_gap = 1.2, goal_x;
static int plain, lanes;
static unsigned char view[1 << 24], command[4096], truth[1 << 24], out[2][512], config[4096];
static int view_size, command_size, truth_size, out_size, turn, config_size;

static unsigned long varint(span *s) {
  unsigned long value = 0;
  for (int shift = 0; s->at < s->end; shift += 7) {
    value |= (unsigned long)(*s->at & 0x7f) << shift;
    if (!(*s->at++ & 0x80)) break;
  }
  return value;
}
/* The next field: its number; its bytes in `inner`, or its number in `value`. 0 at the end. */
static int field(span *s, span *inner, unsigned long *value) {
  if (s->at >= s->end) return 0;
  unsigned long key = varint(s);
  int size = 0;
  if ((key & 7) == 0) { *value = varint(s); return key >> 3; }
  if ((key & 7) == 1) size = 8;
  if ((key & 7) == 5) size = 4;
  if ((key & 7) == 2) size = varint(s);
  inner->at = s->at; inner->end = s->at + size; s->at += size;
  return key >> 3;
}
static double number(span s) { double d; memcpy(&d, s.at, 8); return d; }
static void vector(span s, double *x, double *y, double *z) {
  span in; unsigned long v; int k;
  while ((k = field(&s, &in, &v))) { if (k == 1) *x = number(in); if (k == 2) *y = number(in); if (k == 3) *z = number(in); }
}
static object read_object(span s) {
  object o = {0}; span in, inner; unsigned long v; int k; double z;
  while ((k = field(&s, &in, &v))) {
    if (k == 1) { field(&in, &inner, &v); o.id = v; }
    if (k == 2) while ((k = field(&in, &inner, &v))) {
      double roll, pitch;
      if (k == 1) vector(inner, &o.length, &z, &z);
      if (k == 2) vector(inner, &o.x, &o.y, &z);
      if (k == 3) vector(inner, &roll, &pitch, &o.yaw);
      if (k == 4) vector(inner, &o.vx, &o.vy, &z);
    }
  }
  return o;
}
static unsigned char *put_key(unsigned char *at, int number, int kind) { *at++ = number << 3 | kind; return at; }
static unsigned char *put_double(unsigned char *at, int number, double value) {
  at = put_key(at, number, 1); memcpy(at, &value, 8); return at + 8;
}
static unsigned char *put_bytes(unsigned char *at, int number, const unsigned char *from, int size) {
  at = put_key(at, number, 2); *at++ = size; memcpy(at, from, size); return at + size; /* up to 127 bytes */
}
static unsigned char *put_vector(unsigned char *at, int number, double x, double y) {
  unsigned char inner[32], *end = put_double(inner, 1, x);
  end = put_double(end, 2, y);
  return put_bytes(at, number, inner, end - inner);
}
static unsigned char *put_point(unsigned char *at, double t, double x, double y, double yaw) {
  unsigned char inner[120], stamp[32], turned[16], *end, *last = stamp;
  long nanos = lround(t * 1e9), parts[2] = {nanos / 1000000000, nanos % 1000000000};
  for (int k = 0; k < 2; k++) {
    last = put_key(last, k + 1, 0);
    unsigned long v = parts[k];
    do { *last++ = (v & 0x7f) | (v > 0x7f ? 0x80 : 0); v >>= 7; } while (v);
  }
  end = put_bytes(inner, 1, stamp, last - stamp);
  end = put_vector(end, 2, x, y);
  end = put_bytes(end, 3, turned, put_double(turned, 3, yaw) - turned);
  return put_bytes(at, 8, inner, end - inner);
}
static void step(double now, double dt) {
  object ego = {0}, one[64]; int count = 0; unsigned long host = 0, v; int k;
  span s = {view, view + view_size}, in, inner, deep;
  if (!view_size) { out_size = 0; return; }
  lanes = 0;
  while ((k = field(&s, &in, &v)))
    if (k == 7) while ((k = field(&in, &inner, &v))) {
      if (k == 3) { field(&inner, &deep, &v); host = v; }
      if (k == 5 && count < 64) one[count++] = read_object(inner);
      if (k == 10) lanes++;
    }
  s.at = truth; s.end = truth + truth_size;
  while ((k = field(&s, &in, &v))) if (k == 10) lanes++;
  for (k = 0; k < count; k++) if (one[k].id == (long)host) ego = one[k];
  double c = cos(ego.yaw), n = sin(ego.yaw), speed = ego.vx * c + ego.vy * n, a = 0.4 * (25.0 - speed);
  for (k = 0; k < count; k++) {
    double ahead = (one[k].x - ego.x) * c + (one[k].y - ego.y) * n, left = (one[k].y - ego.y) * c - (one[k].x - ego.x) * n;
    if (one[k].id == ego.id || ahead <= 0 || fabs(left) > 1.5) continue;
    double gap = ahead - 0.5 * (one[k].length + ego.length);
    double lead = one[k].vx * c + one[k].vy * n, wanted = 0.25 * (gap - 4.0 - time_gap * speed) + 0.8 * (lead - speed);
    if (wanted < a) a = wanted;
  }
  a = fmin(fmax(a, -8.0), 2.0);
  if (!lanes) a = -8.0; /* a unit without a map brakes: so a test sees whether it got one */
  double next = fmax(speed + a * dt, 0.0), way = 0.5 * (speed + next) * dt;
  unsigned char base[120], turned[16], object_[400], id[16], *end = put_key(id, 1, 0), *last;
  *end++ = host;
  last = put_bytes(object_, 1, id, end - id);
  end = put_vector(base, 2, ego.x + way * c, ego.y + way * n);
  end = put_bytes(end, 3, turned, put_double(turned, 3, ego.yaw) - turned);
  end = put_vector(end, 4, next * c, next * n);
  if (plain != 2) last = put_bytes(last, 2, base, end - base);
  if (plain != 1)
    for (k = 0; k < 3; k++) {
      double t = k * dt;
      last = put_point(last, now + t, ego.x + (speed * t + 0.5 * a * t * t) * c, ego.y + (speed * t + 0.5 * a * t * t) * n, ego.yaw);
    }
  turn = !turn; /* what was given lasts until the end of the next step */
  int size = last - object_;
  unsigned char *to = put_key(out[turn], 3, 2);
  do { *to++ = (size & 0x7f) | (size > 0x7f ? 0x80 : 0); size >>= 7; } while (size);
  memcpy(to, object_, last - object_);
  out_size = to - out[turn] + (last - object_);
}
#if FMI == 3
fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
  fmi3Boolean logging, fmi3Boolean events, fmi3Boolean early, const fmi3ValueReference required[], size_t count,
  fmi3InstanceEnvironment environment, fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback update) { return out; }
void fmi3FreeInstance(fmi3Instance c) {}
fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean b, fmi3Float64 t, fmi3Float64 s, fmi3Boolean d, fmi3Float64 e) { return fmi3OK; }
fmi3Status fmi3ExitInitializationMode(fmi3Instance c) { return fmi3OK; }
fmi3Status fmi3Terminate(fmi3Instance c) { return fmi3OK; }
fmi3Status fmi3SetBinary(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const size_t sizes[], const fmi3Binary values[], size_t m) {
  unsigned char *to = vr[0] == 0 ? view : truth;
  memcpy(to, values[0], sizes[0]);
  *(vr[0] == 0 ? &view_size : &truth_size) = sizes[0];
  return fmi3OK;
}
fmi3Status fmi3GetBinary(fmi3Instance c, const fmi3ValueReference vr[], size_t n, size_t sizes[], fmi3Binary values[], size_t m) {
  values[0] = out[turn]; sizes[0] = out_size; return fmi3OK;
}
fmi3Status fmi3SetInt32(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3Int32 values[], size_t m) {
  plain = values[0]; return fmi3OK;
}
fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 now, fmi3Float64 dt, fmi3Boolean no, fmi3Boolean *event, fmi3Boolean *terminate,
  fmi3Boolean *early, fmi3Float64 *last) { *event = *terminate = *early = 0; *last = now + dt; step(now, dt); return fmi3OK; }
#else
static int set[32];
static void *buffer(int k) { return (void *)((unsigned long)(unsigned)set[k + 1] << 32 | (unsigned)set[k]); }
fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
  const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean logging) { return set; }
void fmi2FreeInstance(fmi2Component c) {}
fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean d, fmi2Real e, fmi2Real t, fmi2Boolean b, fmi2Real s) { return fmi2OK; }
fmi2Status fmi2EnterInitializationMode(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
  config_size = set[11];
  if (set[11]) memcpy(config, buffer(9), set[11]);
  return fmi2OK;
}
fmi2Status fmi2Terminate(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Integer values[]) {
  for (size_t k = 0; k < n; k++) set[vr[k]] = values[k];
  plain = set[20];
  return fmi2OK;
}
fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Integer values[]) {
  static const unsigned char request[] = {0x12, 0x02, 0x08, 0x07}; /* of sensor 7 */
  for (size_t k = 0; k < n; k++) {
    int of = vr[k] < 6 ? 3 : 6;
    unsigned long at = of == 3 ? (unsigned long)out[turn] : (unsigned long)request;
    int parts[3] = {(int)at, (int)(at >> 32), of == 3 ? out_size : (int)sizeof request};
    values[k] = parts[vr[k] - of];
  }
  return fmi2OK;
}
fmi2Status fmi2DoStep(fmi2Component c, fmi2Real now, fmi2Real dt, fmi2Boolean no) {
  view_size = set[2]; memcpy(view, buffer(0), set[2]);
  if (now == 0.0 && !set[14]) return fmi2Error; /* where to go is said once, before the first step */
  if (now > 0.0 && set[14]) return fmi2Error;
  if (!config_size || !memmem(config, config_size, "\x12\x02\x08\x07", 4)) return fmi2Error;
  step(now, dt);
  return fmi2OK;
}
#endif
