/* A small process model as an FMU of FMI 2: two stores of first order, and ways to fail on request. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { GRAIN_IN, STRAW_IN, TIME_CONSTANT, LOSS, FAIL_AT, TANK, LOST, DROPPED, HELD_GRAIN, HELD_STRAW,
       GRAIN_FLOW, STRAW_FLOW, STEPS, A0, A1, A2, SUM, REALS };
enum { FINE, CRASH, HANG, NOT_A_NUMBER, FAILS, FATAL, SHORT, ENDS };

typedef void (*Logger)(void *, const char *, int, const char *, const char *, ...);
typedef struct { Logger log; void *alloc, *free, *done, *env; } Callbacks;
typedef struct { double r[REALS]; int mode; int flag; double reached; Callbacks *callbacks; char name[200]; } Model;

#ifndef FIRST_MODE
#define FIRST_MODE FINE
#endif
static int instances = 0, started = 0;

static void defaults(Model *m) {
  memset(m->r, 0, sizeof m->r);
  m->r[TIME_CONSTANT] = 1.0; m->r[LOSS] = 0.01; m->r[FAIL_AT] = 0.5;
  m->mode = FIRST_MODE; m->flag = 0;
}
void *fmi2Instantiate(const char *name, int kind, const char *guid, const char *where, Callbacks *c, int v, int l) {
#ifdef ONLY_ONE
  if (instances > 0) return NULL;
#endif
#ifdef STARTS_ONCE
  if (started++ > 0) *(volatile int *)0 = 1;
#endif
  instances++;
  Model *m = calloc(1, sizeof *m);
  strncpy(m->name, name, 199);
  m->callbacks = c; defaults(m);
  return m;
}
void fmi2FreeInstance(void *m) { instances--; free(m); }
int fmi2SetDebugLogging(void *m, int on, size_t n, const char *const *c) { return 0; }
int fmi2SetupExperiment(void *m, int a, double b, double c, int d, double e) { return 0; }
int fmi2EnterInitializationMode(void *m) { return 0; }
int fmi2ExitInitializationMode(void *m) { return 0; }
int fmi2Terminate(void *m) { return 0; }
int fmi2Reset(void *m) { return 0; } /* resets nothing, as some exporters do */
int fmi2SetReal(Model *m, const unsigned *vr, size_t n, const double *v) {
  for (size_t i = 0; i < n; i++) m->r[vr[i]] = v[i];
  return 0;
}
int fmi2GetReal(Model *m, const unsigned *vr, size_t n, double *v) {
  m->r[SUM] = m->r[A0] + 10.0 * m->r[A1] + 100.0 * m->r[A2];
  for (size_t i = 0; i < n; i++) v[i] = m->r[vr[i]];
  return 0;
}
int fmi2SetInteger(Model *m, const unsigned *vr, size_t n, const int *v) { m->mode = v[0]; return 0; }
int fmi2GetInteger(Model *m, const unsigned *vr, size_t n, int *v) { v[0] = m->mode; return 0; }
int fmi2SetBoolean(Model *m, const unsigned *vr, size_t n, const int *v) { m->flag = v[0]; return 0; }
int fmi2GetBoolean(Model *m, const unsigned *vr, size_t n, int *v) { v[0] = m->flag; return 0; }

static double store(double *held, double in, double h, double lag) {
  double kept = exp(-h / lag), before = *held;
  *held = before * kept + in * lag * (1.0 - kept);
  return before + in * h - *held;
}
int fmi2DoStep(Model *m, double t, double h, int back) {
  if (m->mode != FINE && t + 1e-9 >= m->r[FAIL_AT]) {
    if (m->mode == CRASH) *(volatile int *)0 = 1;
    if (m->mode == HANG) for (volatile int i = 0;; i++) {}
    if (m->mode == NOT_A_NUMBER) m->r[TANK] = NAN;
    if (m->mode == FAILS || m->mode == FATAL) {
      m->callbacks->log(m->callbacks->env, m->name, m->mode == FAILS ? 3 : 4, "logStatusError", "belt %d is torn", 7);
      return m->mode == FAILS ? 3 : 4;
    }
    if (m->mode == ENDS) return 2;
  }
  int status = 0;
  if (m->mode == SHORT && h > 0.013) { h = 0.013; status = 2; }
  double grain = store(&m->r[HELD_GRAIN], m->r[GRAIN_IN], h, m->r[TIME_CONSTANT]);
  double straw = store(&m->r[HELD_STRAW], m->r[STRAW_IN], h, m->r[TIME_CONSTANT]);
  m->r[TANK] += grain * (1.0 - m->r[LOSS]);
  m->r[LOST] += grain * m->r[LOSS];
  m->r[DROPPED] += straw;
  m->r[GRAIN_FLOW] = grain / h; m->r[STRAW_FLOW] = straw / h;
  m->r[STEPS] += 1.0;
  m->reached = t + h;
  return status;
}
int fmi2GetRealStatus(Model *m, int kind, double *v) { *v = m->reached; return 0; }
int fmi2GetBooleanStatus(Model *m, int kind, int *v) { *v = m->mode == ENDS; return 0; }
#ifndef NO_STATES
int fmi2GetFMUstate(Model *m, void **s) { *s = malloc(sizeof *m); memcpy(*s, m, sizeof *m); return 0; }
int fmi2SetFMUstate(Model *m, void *s) { memcpy(m, s, sizeof *m); return 0; }
int fmi2FreeFMUstate(Model *m, void **s) { free(*s); *s = NULL; return 0; }
int fmi2SerializedFMUstateSize(Model *m, void *s, size_t *n) { *n = sizeof m->r + sizeof m->mode; return 0; }
int fmi2SerializeFMUstate(Model *m, void *s, char *b, size_t n) {
  memcpy(b, ((Model *)s)->r, sizeof m->r); memcpy(b + sizeof m->r, &((Model *)s)->mode, sizeof m->mode);
  return 0;
}
int fmi2DeSerializeFMUstate(Model *m, const char *b, size_t n, void **s) {
  Model *made = malloc(sizeof *m);
  memcpy(made, m, sizeof *m); memcpy(made->r, b, sizeof m->r); memcpy(&made->mode, b + sizeof m->r, sizeof m->mode);
  *s = made;
  return 0;
}
#endif
/* functions that importers other than ours want to be there */
const char *fmi2GetVersion(void) { return "2.0"; }
const char *fmi2GetTypesPlatform(void) { return "default"; }
int fmi2GetString(void *m, const unsigned *vr, size_t n, const char **v) { return 3; }
int fmi2SetString(void *m, const unsigned *vr, size_t n, const char *const *v) { return 3; }
int fmi2CancelStep(void *m) { return 3; }
int fmi2GetStatus(void *m, int kind, int *v) { return 3; }
int fmi2GetIntegerStatus(void *m, int kind, int *v) { return 3; }
int fmi2GetStringStatus(void *m, int kind, const char **v) { return 3; }
#ifndef NO_DERIVATIVES
int fmi2GetDirectionalDerivative(void *m, const unsigned *a, size_t n, const unsigned *b, size_t k, const double *x, double *y) { return 3; }
int fmi2SetRealInputDerivatives(void *m, const unsigned *a, size_t n, const int *o, const double *v) { return 3; }
int fmi2GetRealOutputDerivatives(void *m, const unsigned *a, size_t n, const int *o, double *v) { return 3; }
#endif
