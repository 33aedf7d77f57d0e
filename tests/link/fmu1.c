/* The process model of fmu2.c, smaller, as an FMU of FMI 1.0: two stores of first order. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { GRAIN_IN, STRAW_IN, TIME_CONSTANT, LOSS, FAIL_AT, TANK, LOST, DROPPED, HELD_GRAIN, HELD_STRAW,
       GRAIN_FLOW, STRAW_FLOW, STEPS, A0, A1, A2, SUM, REALS };
typedef void (*Logger)(void *, const char *, int, const char *, const char *, ...);
typedef struct { Logger log; void *alloc, *free, *done; } Callbacks;
typedef struct { double r[REALS]; int is_ready; double reached; Callbacks callbacks; char name[200]; } Model;

void *store_fmiInstantiateSlave(const char *name, const char *guid, const char *where, const char *mime,
    double timeout, char visible, char interactive, Callbacks c, char logs) {
  if (strncmp(where, "file:///", 8) || strcmp(mime, "application/x-fmu-sharedlibrary")) return NULL;
  Model *m = calloc(1, sizeof *m);
  strncpy(m->name, name, 199);
  m->callbacks = c; m->r[TIME_CONSTANT] = 1.0; m->r[LOSS] = 0.01; m->r[FAIL_AT] = 1e9;
  return m;
}
void store_fmiFreeSlaveInstance(void *m) { free(m); }
int store_fmiInitializeSlave(Model *m, double start, char has_end, double end) { m->is_ready = 1; return has_end ? 3 : 0; }
int store_fmiTerminateSlave(Model *m) { return 0; }
int store_fmiSetReal(Model *m, const unsigned *vr, size_t n, const double *v) {
  for (size_t i = 0; i < n; i++) m->r[vr[i]] = v[i];
  return 0;
}
int store_fmiGetReal(Model *m, const unsigned *vr, size_t n, double *v) {
  for (size_t i = 0; i < n; i++) v[i] = m->r[vr[i]];
  return 0;
}
int store_fmiSetInteger(Model *m, const unsigned *vr, size_t n, const int *v) { return 0; }
static double store(double *held, double in, double h, double lag) {
  double kept = exp(-h / lag), before = *held;
  *held = before * kept + in * lag * (1.0 - kept);
  return before + in * h - *held;
}
int store_fmiDoStep(Model *m, double t, double h, char is_new) {
  if (!m->is_ready || !is_new) return 3;
  if (t + 1e-9 >= m->r[FAIL_AT]) {
    m->callbacks.log(m, m->name, 3, "error", "belt %d is torn", 7);
    return 3;
  }
  int status = 0;
  if (m->r[SUM] == 1.0 && h > 0.013) { h = 0.013; status = 2; }
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
int store_fmiGetRealStatus(Model *m, int kind, double *v) { *v = m->reached; return kind == 2 ? 0 : 3; }
