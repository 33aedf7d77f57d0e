// Ways of machines in safe intervals over the graph of a job. The body of a native function; its arrays are those of
// kernel.py.
//
// Resources are edges, then the poses at which one stands; who has one for a time has all that meet it. Reserved times are
// lists of a resource: machine, grant, from, to; of a grant that is dead they do not count. Who stands for good has its pose
// from a time on.
//
// mode 0: earliest arrival at one of some goals (Phillips and Likhachev 2011); 1: earliest along given edges; 2: reserve;
// 3: least times from a node over ground that will be cut, without others.

typedef double D;
const D INF = 1e18;
D* m = (D*)its.numbers.data;
const int mode = (int)m[0], me = (int)m[1], start = (int)m[2], rows = (int)m[3], edges = (int)m[4], nodes = (int)m[5], machines = (int)m[6];
const D time = m[7], gap = m[8], extra_start = m[9];
const int cap = (int)m[10], room = (int)m[11], partial = (int)m[12];
const D* given = (const D*)its.given.data;
D* found = (D*)its.found.data;
const int *succ_at = (const int*)its.succ_at.data, *succ = (const int*)its.succ.data, *pred_at = (const int*)its.pred_at.data, *pred = (const int*)its.pred.data;
const int *from = (const int*)its.edge_from.data, *to = (const int*)its.edge_to.data;
const int *conf_at = (const int*)its.conf_at.data, *conf = (const int*)its.conf.data, *need_at = (const int*)its.need_at.data, *need = (const int*)its.need.data;
const D *spent = (const D*)its.spent.data, *cut = (const D*)its.cut.data;
const unsigned char *exempt = (const unsigned char*)its.exempt.data, *dead = (const unsigned char*)its.dead.data;
int *head = (int*)its.head.data, *next = (int*)its.next.data, *who = (int*)its.who.data, *grant = (int*)its.grant.data;
D *begin = (D*)its.begin.data, *until = (D*)its.until.data, *counts = (D*)its.counts.data;
const D* parked = (const D*)its.parked.data;  // node, since of each machine
D* since = (D*)its.since.data;
int *stamp = (int*)its.stamp.data, *iv_at = (int*)its.iv_at.data, *iv_count = (int*)its.iv_count.data;
D* iv = (D*)its.iv.data;  // pairs
D* labels = (D*)its.labels.data;  // t, end, parent, edge, depart, node, next of the node; 7 each
int* first = (int*)its.first.data;
D *heap_key = (D*)its.heap_key.data, *h = (D*)its.h.data;
int *heap_node = (int*)its.heap_node.data;
D* goal = (D*)its.goal.data;  // row of each node or -1
const int resources = edges + nodes;
found[0] = -1.0;

if (mode == 2) {  // rows: resource, from, to, grant
  int used = (int)counts[0];
  for (int k = 0; k < rows; ++k) {
    const int r = (int)given[4 * k], g = (int)given[4 * k + 3];
    const D a = given[4 * k + 1], b = given[4 * k + 2];
    for (int c = conf_at[r]; c < conf_at[r + 1]; ++c) {
      const int o = conf[c], n = head[o];
      if (n >= 0 && grant[n] == g && a <= until[n] + 1e-6 && a >= begin[n]) { if (b > until[n]) until[n] = b; continue; }
      if (used >= room) { counts[0] = used; return; }
      who[used] = me; grant[used] = g; begin[used] = a; until[used] = b; next[used] = n; head[o] = used++;
    }
  }
  counts[0] = used; found[0] = used;
  return;
}

auto ready = [&](int r) {
  D s = 0.0;
  for (int k = need_at[r]; k < need_at[r + 1]; ++k) if (!exempt[need[k]] && cut[need[k]] > s) s = cut[need[k]];
  return s;
};
int heap_size = 0;
auto push = [&](D key, int n) {
  int i = heap_size++;
  for (; i > 0; i = (i - 1) / 2) {
    const int p = (i - 1) / 2;
    if (heap_key[p] < key || (heap_key[p] == key && heap_node[p] <= n)) break;
    heap_key[i] = heap_key[p]; heap_node[i] = heap_node[p];
  }
  heap_key[i] = key; heap_node[i] = n;
};
auto pop = [&]() {
  const int top = heap_node[0];
  --heap_size;
  const D key = heap_key[heap_size]; const int n = heap_node[heap_size];
  int i = 0;
  for (;;) {
    int c = 2 * i + 1;
    if (c >= heap_size) break;
    if (c + 1 < heap_size && (heap_key[c + 1] < heap_key[c] || (heap_key[c + 1] == heap_key[c] && heap_node[c + 1] < heap_node[c]))) ++c;
    if (key < heap_key[c] || (key == heap_key[c] && n <= heap_node[c])) break;
    heap_key[i] = heap_key[c]; heap_node[i] = heap_node[c]; i = c;
  }
  heap_key[i] = key; heap_node[i] = n;
  return top;
};

if (mode == 3) {  // least times from a node; found[1 + node]
  for (int n = 0; n < nodes; ++n) found[1 + n] = INF;
  found[1 + start] = 0.0;
  push(0.0, start);
  while (heap_size) {
    const D t = heap_key[0]; const int n = pop();
    if (t > found[1 + n]) continue;
    for (int k = succ_at[n]; k < succ_at[n + 1]; ++k) {
      const int e = succ[k];
      const D s = ready(e);
      if (s >= INF) continue;
      D a = t + spent[e];
      if (s - time > t) a = s - time + spent[e];
      if (a < found[1 + to[e]] && heap_size < cap) { found[1 + to[e]] = a; push(a, to[e]); }
    }
  }
  found[0] = nodes;
  return;
}

// who stands for good
for (int r = 0; r < resources; ++r) { since[r] = INF; stamp[r] = 0; }
for (int k = 0; k < machines; ++k) {
  if (k == me || parked[2 * k] < 0) continue;
  const int r = edges + (int)parked[2 * k];
  for (int c = conf_at[r]; c < conf_at[r + 1]; ++c) if (parked[2 * k + 1] < since[conf[c]]) since[conf[c]] = parked[2 * k + 1];
}
int used = 0;
const int most = (int)m[13];
auto intervals = [&](int r) {  // free ones from `time` on
  if (stamp[r]) return;
  stamp[r] = 1;
  const int at = used;
  iv_at[r] = at; iv_count[r] = 0;
  D s = ready(r);
  if (s >= INF) return;
  if (s < time) s = time;
  int n = 0;
  D* own = iv + 2 * at;
  if (at + 400 > most) return;
  for (int k = head[r]; k >= 0 && n < 390; k = next[k]) {
    if (who[k] == me || dead[grant[k]] || until[k] + gap <= s) continue;
    D a = begin[k] - gap, b = until[k] + gap;
    int i = n++;
    for (; i > 0 && own[2 * i - 2] > a; --i) { own[2 * i] = own[2 * i - 2]; own[2 * i + 1] = own[2 * i - 1]; }
    own[2 * i] = a; own[2 * i + 1] = b;
  }
  const D last = since[r] - gap;
  int out = 0;
  for (int i = 0; i < n; ++i) {  // in place: a free one lies before each that is taken
    const D a = own[2 * i], b = own[2 * i + 1];
    const D end = a < last ? a : last;
    if (end > s) { own[2 * out] = s; own[2 * out + 1] = end; ++out; }
    if (b > s) s = b;
    if (s >= last) break;
  }
  if (s < last) { own[2 * out] = s; own[2 * out + 1] = since[r] >= INF ? INF : last; ++out; }
  iv_count[r] = out;
  used += out;
};

if (mode == 1) {  // given: edge, least time in it; labels: t, end, parent, depart
  int count = 1, base = 0;
  intervals(edges + start);
  D end = -1.0;
  for (int i = 0; i < iv_count[edges + start]; ++i) {
    const D* p = iv + 2 * (iv_at[edges + start] + i);
    if (p[0] <= time + 1e-6 && p[1] > time) end = p[1];
  }
  if (end < 0.0) end = time + 5.0;  // it stands where it does
  labels[0] = time; labels[1] = end; labels[2] = -1; labels[3] = 0;
  int best = -1, stage = -1, lo = 0, hi = 1;
  for (int k = 0; k < rows; ++k) {
    const int e = (int)given[2 * k], v = edges + to[e];
    const D dt = given[2 * k + 1];
    intervals(e); intervals(v);
    const int begin_at = hi;
    int n = hi;
    for (int l = lo; l < hi; ++l)
      for (int i = 0; i < iv_count[e]; ++i)
        for (int j = 0; j < iv_count[v]; ++j) {
          const D *p = iv + 2 * (iv_at[e] + i), *q = iv + 2 * (iv_at[v] + j);
          D x = labels[7 * l];
          if (p[0] > x) x = p[0];
          if (q[0] - dt > x) x = q[0] - dt;
          if (x > labels[7 * l + 1] || x + dt > p[1] || x + dt > q[1]) continue;
          int o = begin_at;
          for (; o < n; ++o) if (labels[7 * o + 1] == q[1]) break;
          if (o < n && labels[7 * o] <= x + dt) continue;
          if (o == n) ++n;
          D* a = labels + 7 * o;
          a[0] = x + dt; a[1] = q[1]; a[2] = l; a[3] = x;
        }
    if (n == begin_at) break;
    lo = begin_at; hi = n;
    for (int l = lo; l < hi; ++l) if (labels[7 * l + 1] >= INF && (k == rows - 1 || partial)) {
      if (stage != k || labels[7 * l] < labels[7 * best]) { best = l; stage = k; }
    }
  }
  if (best < 0) return;
  found[0] = stage + 1; found[1] = labels[7 * best + 1];
  for (int k = stage, l = best; k >= 0; --k) {
    D* row = found + 3 + 3 * k;
    row[0] = given[2 * k]; row[1] = labels[7 * l + 3]; row[2] = labels[7 * l];
    l = (int)labels[7 * l + 2];
  }
  return;
}

// mode 0: given: node, stand until, for how long, latest arrival, extra cost
for (int n = 0; n < nodes; ++n) { goal[n] = -1; first[n] = -1; h[n] = INF; }
for (int k = 0; k < rows; ++k) { const int n = (int)given[5 * k]; goal[n] = k; if (given[5 * k + 4] < h[n]) { h[n] = given[5 * k + 4]; push(h[n], n); } }
while (heap_size) {  // least times to goals
  const D t = heap_key[0]; const int n = pop();
  if (t > h[n]) continue;
  for (int k = pred_at[n]; k < pred_at[n + 1]; ++k) {
    const int e = pred[k];
    if (ready(e) >= INF) continue;
    const D a = t + spent[e];
    if (a < h[from[e]] && heap_size < cap) { h[from[e]] = a; push(a, from[e]); }
  }
}
if (h[start] >= INF) { found[0] = -2.0; return; }
D end = -1.0;
intervals(edges + start);
for (int i = 0; i < iv_count[edges + start]; ++i) {
  const D* p = iv + 2 * (iv_at[edges + start] + i);
  if (p[0] <= time + 1e-6 && p[1] > time) end = p[1];
}
if (end < 0.0) end = time + 5.0;
D* a = labels;
a[0] = time; a[1] = end; a[2] = -1; a[3] = -1; a[4] = 0; a[5] = start; a[6] = -1;
int count = 1, looked = 0;
first[start] = 0;
heap_size = 0;
push(time + h[start], 0);
const int most_labels = (int)m[14], limit = (int)m[15];
while (heap_size) {
  const D key = heap_key[0];
  const int l = pop();
  const D t = labels[7 * l], close = labels[7 * l + 1];
  const int n = (int)labels[7 * l + 5];
  if (goal[n] >= 0) {
    const D* g = given + 5 * (int)goal[n];
    D need_until = g[1] > t + g[2] ? g[1] : t + g[2];
    if (t <= g[3] && (close >= need_until || close >= INF) && key >= t + g[4] - 1e-6) {
      int k = 0;
      for (int i = l; labels[7 * i + 2] >= 0; i = (int)labels[7 * i + 2]) ++k;
      found[0] = k; found[1] = close; found[2] = goal[n];
      for (int i = l; labels[7 * i + 2] >= 0; i = (int)labels[7 * i + 2]) {
        D* row = found + 3 + 3 * --k;
        row[0] = labels[7 * i + 3]; row[1] = labels[7 * i + 4]; row[2] = labels[7 * i];
      }
      return;
    }
  }
  if (++looked > limit) return;
  for (int k = succ_at[n]; k < succ_at[n + 1]; ++k) {
    const int e = succ[k], b = to[e], v = edges + b;
    if (h[b] >= INF) continue;
    intervals(e);
    if (!iv_count[e]) continue;
    intervals(v);
    const D dt = spent[e] + (labels[7 * l + 2] < 0 ? extra_start : 0.0);
    for (int i = 0; i < iv_count[e]; ++i) {
      const D* p = iv + 2 * (iv_at[e] + i);
      if (p[0] > close) break;
      for (int j = 0; j < iv_count[v]; ++j) {
        const D* q = iv + 2 * (iv_at[v] + j);
        D x = t > p[0] ? t : p[0];
        if (q[0] - dt > x) x = q[0] - dt;
        if (x > close || x + dt > p[1]) break;
        if (x + dt > q[1]) continue;
        const D y = x + dt;
        int o = first[b];
        for (; o >= 0; o = (int)labels[7 * o + 6]) if (labels[7 * o + 1] == q[1] && labels[7 * o] <= y + 1e-6) break;
        if (o >= 0 || count >= most_labels || heap_size >= cap) continue;
        D* c = labels + 7 * count;
        c[0] = y; c[1] = q[1]; c[2] = l; c[3] = e; c[4] = x; c[5] = b; c[6] = first[b];
        first[b] = count;
        push(y + h[b], count++);
      }
    }
  }
}
