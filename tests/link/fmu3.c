/* A small engine as an FMU of FMI 3: arrays, event mode, early return, a periodic clock, a time event. */
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

enum { GROUND_SPEED, SPEED, FUEL, FUEL_USED, LIMIT, EVENTS, TICKS, TIME_EVENTS, SWITCHES, EARLY, LENGTH,
       X, Y, TICK, GEAR, ENGAGED, SCALARS };
#define MOST 16
enum { STEP, EVENT };

typedef struct {
  double r[LENGTH]; uint64_t length; double x[MOST]; int64_t gear; bool engaged;
  int mode; bool uses_events, may_return, ticked; double now, next, early; char clocked;
} Model;

void *fmi3InstantiateCoSimulation(const char *name, const char *token, const char *where, bool visible, bool log,
    bool events, bool early, const unsigned *r, size_t n, void *env, void *logger, void *update) {
#ifdef NO_EVENT_MODE
  if (events) return NULL;
#endif
  Model *m = calloc(1, sizeof *m);
  m->uses_events = events; m->may_return = early; m->length = 3; m->mode = EVENT;
  m->r[SPEED] = 2000.0; m->r[LIMIT] = 30.0; m->next = 0.05; m->r[EARLY] = 1e9;
  return m;
}
void fmi3FreeInstance(void *m) { free(m); }
int fmi3EnterInitializationMode(Model *m, bool a, double b, double start, bool c, double d) { m->now = start; return 0; }
int fmi3ExitInitializationMode(Model *m) { m->mode = m->uses_events ? EVENT : STEP; return 0; }
int fmi3EnterConfigurationMode(Model *m) { return 0; }
int fmi3ExitConfigurationMode(Model *m) { return 0; }
int fmi3EnterEventMode(Model *m) { if (m->mode == EVENT) return 3; m->mode = EVENT; m->r[EVENTS] += 1; return 0; }
int fmi3EnterStepMode(Model *m) { if (m->mode == STEP) return 3; m->mode = STEP; return 0; }
int fmi3Terminate(Model *m) { return 0; }
int fmi3Reset(Model *m) { return 3; }
int fmi3SetFloat64(Model *m, const unsigned *vr, size_t n, const double *v, size_t values) {
  for (size_t i = 0; i < n; i++) {
    if (vr[i] == X) { memcpy(m->x, v, m->length * sizeof *v); v += m->length; }
    else m->r[vr[i]] = *v++;
  }
  return 0;
}
int fmi3GetFloat64(Model *m, const unsigned *vr, size_t n, double *v, size_t values) {
  for (size_t i = 0; i < n; i++) {
    if (vr[i] == Y) for (size_t k = 0; k < m->length; k++) *v++ = 2.0 * m->x[k];
    else *v++ = m->r[vr[i]];
  }
  return 0;
}
int fmi3SetUInt64(Model *m, const unsigned *vr, size_t n, const uint64_t *v, size_t values) { m->length = v[0]; return 0; }
int fmi3GetUInt64(Model *m, const unsigned *vr, size_t n, uint64_t *v, size_t values) { v[0] = m->length; return 0; }
int fmi3SetInt64(Model *m, const unsigned *vr, size_t n, const int64_t *v, size_t values) { m->gear = v[0]; return 0; }
int fmi3GetInt64(Model *m, const unsigned *vr, size_t n, int64_t *v, size_t values) { v[0] = m->gear; return 0; }
int fmi3SetBoolean(Model *m, const unsigned *vr, size_t n, const bool *v, size_t values) {
  if (m->uses_events && m->mode != EVENT) return 3;
  if (m->engaged != v[0]) m->r[SWITCHES] += 1;
  m->engaged = v[0];
  return 0;
}
int fmi3GetBoolean(Model *m, const unsigned *vr, size_t n, bool *v, size_t values) { v[0] = m->engaged; return 0; }
int fmi3SetClock(Model *m, const unsigned *vr, size_t n, const bool *v) {
  if (m->mode != EVENT) return 3;
  if (v[0]) m->r[TICKS] += 1;
  return 0;
}
int fmi3UpdateDiscreteStates(Model *m, bool *again, bool *ends, bool *nominals, bool *values, bool *has, double *next) {
  if (m->mode != EVENT) return 3;
  if (m->now + 1e-9 >= m->next) { m->r[TIME_EVENTS] += 1; m->next += 0.05; }
  *again = *ends = *nominals = *values = false;
  *has = true; *next = m->next;
  return 0;
}
int fmi3DoStep(Model *m, double t, double h, bool back, bool *event, bool *ends, bool *early, double *reached) {
  if (m->mode != STEP || fabs(t - m->now) > 1e-9) return 3;
  if (m->uses_events && t + h > m->next + 1e-9) return 3;
  *event = *ends = *early = false;
  if (m->may_return && t < m->r[EARLY] - 1e-9 && t + h > m->r[EARLY] + 1e-9) { h = m->r[EARLY] - t; *early = *event = true; }
  m->r[FUEL] = 1e-3 * (5.0 + m->r[GROUND_SPEED]);
  m->r[FUEL_USED] += m->r[FUEL] * h;
  m->r[SPEED] = 2000.0 - 10.0 * m->r[GROUND_SPEED];
  m->now = t + h; *reached = m->now;
  return 0;
}
int fmi3SetDebugLogging(void *m, bool on, size_t n, const char *const *c) { return 0; }
int fmi3GetFMUState(Model *m, void **s) { *s = malloc(sizeof *m); memcpy(*s, m, sizeof *m); return 0; }
int fmi3SetFMUState(Model *m, void *s) { memcpy(m, s, sizeof *m); return 0; }
int fmi3FreeFMUState(Model *m, void **s) { free(*s); *s = NULL; return 0; }
