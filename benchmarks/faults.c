/* Faults of writing to one folder, for benchmarks/kills.py: preloaded into a process and all that it starts.

FAULTS_OF_WRITES = "KIND AT WHOM COUNTER FOLDER". Writes to regular files of the folder, and files of it that take a
name or go, are counted over all processes in the file COUNTER. At number AT:
  kill  the process goes before it          torn  it writes half, then goes
  lost  the process goes, and of every file that took its name without being synced only the half is left
  full  the disk is full from then on       short every write writes less than it is given
WHOM: one, the process; all, everything in its process group. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/uio.h>
#include <unistd.h>

#define MOST 4096
static volatile uint64_t *counter;
static uint64_t at;
static char kind[8], whom[8], folder[MOST];
static struct { dev_t dev; ino_t ino; } unsynced[MOST];
static char named[MOST][512];
static int unsynced_count, named_count;

#define REAL(name) static __typeof__(name) *real; if (!real) real = (__typeof__(name) *)dlsym(RTLD_NEXT, #name)

__attribute__((constructor)) void arm(void) {
  const char *told = getenv("FAULTS_OF_WRITES");
  char place[MOST];
  unsigned long long number;
  counter = NULL;
  if (!told || sscanf(told, "%7s %llu %7s %4095s %4095s", kind, &number, whom, place, folder) != 5) return;
  int file = open(place, O_RDWR | O_CLOEXEC);
  if (file < 0) return;
  void *made = mmap(NULL, sizeof(uint64_t), PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
  close(file);
  if (made != MAP_FAILED) counter = made;
  at = number;
}

static int is_kind(const char *name) { return !strcmp(kind, name); }
static uint64_t event(void) { return __sync_add_and_fetch(counter, 1); }

static void go(void) {
  if (is_kind("lost"))
    for (int k = 0; k < named_count; k++) {
      struct stat about;
      if (!stat(named[k], &about)) (void)!truncate(named[k], about.st_size / 2);
    }
  kill(is_kind("lost") || !strcmp(whom, "all") ? 0 : getpid(), SIGKILL);
  pause();
}

static int is_ours(int file) {
  char link[64], path[MOST];
  struct stat about;
  if (!counter || fstat(file, &about) || !S_ISREG(about.st_mode)) return 0;
  snprintf(link, sizeof link, "/proc/self/fd/%d", file);
  ssize_t size = readlink(link, path, sizeof path - 1);
  return size > 0 && !strncmp(path, folder, strlen(folder));
}

static int place_of(const struct stat *about) {
  for (int k = 0; k < unsynced_count; k++)
    if (unsynced[k].dev == about->st_dev && unsynced[k].ino == about->st_ino) return k;
  return -1;
}

static void wrote(int file) {
  struct stat about;
  if (!fstat(file, &about) && place_of(&about) < 0 && unsynced_count < MOST) {
    unsynced[unsynced_count].dev = about.st_dev;
    unsynced[unsynced_count++].ino = about.st_ino;
  }
}

static void synced(int file) {
  struct stat about;
  int k = fstat(file, &about) ? -1 : place_of(&about);
  if (k >= 0) unsynced[k] = unsynced[--unsynced_count];
}

/* How many bytes of a write go through: -1 none, the disk is full; -2 half of them, then the process goes. */
static ssize_t allowed(int file, size_t size) {
  if (!is_ours(file) || !size) return (ssize_t)size;
  uint64_t number = event();
  wrote(file);
  if (is_kind("full") && number >= at) return errno = ENOSPC, -1;
  if (is_kind("short") && size > 1) return 1 + (ssize_t)((number * 2654435761u + at) % size);
  if (number != at || is_kind("short")) return (ssize_t)size;
  if (is_kind("torn")) return -2;
  go();
  return -1;
}

ssize_t write(int file, const void *data, size_t size) {
  REAL(write);
  ssize_t most = allowed(file, size);
  if (most == -1) return -1;
  if (most == -2) { (void)!real(file, data, size / 2); go(); }
  return real(file, data, (size_t)most);
}

ssize_t pwrite64(int file, const void *data, size_t size, off64_t where) {
  REAL(pwrite64);
  ssize_t most = allowed(file, size);
  if (most == -1) return -1;
  if (most == -2) { (void)!real(file, data, size / 2, where); go(); }
  return real(file, data, (size_t)most, where);
}

ssize_t writev(int file, const struct iovec *parts, int count) {
  REAL(writev);
  if (!counter) return real(file, parts, count);
  for (int k = 0; k < count; k++)
    if (parts[k].iov_len) return write(file, parts[k].iov_base, parts[k].iov_len);
  return 0;
}

/* The path of a name in an open folder. */
static const char *path_in(int in, const char *name, char *path) {
  char link[64];
  ssize_t size = 0;
  if (*name != '/' && in != AT_FDCWD) {
    snprintf(link, sizeof link, "/proc/self/fd/%d", in);
    if ((size = readlink(link, path, MOST - 1)) > 0) path[size++] = '/';
    else size = 0;
  }
  snprintf(path + size, MOST - (size_t)size, "%s", name);
  return path;
}

int renameat(int in, const char *from, int into, const char *to) {
  REAL(renameat);
  struct stat about;
  char path[MOST];
  if (!counter || strncmp(path_in(into, to, path), folder, strlen(folder)) || fstatat(in, from, &about, 0))
    return real(in, from, into, to);
  int is_hit = event() == at && !is_kind("full") && !is_kind("short");
  if (is_hit && !is_kind("lost")) go();
  int found = real(in, from, into, to);
  if (!found && place_of(&about) >= 0 && named_count < MOST) snprintf(named[named_count++], 512, "%s", path);
  if (is_hit) go();
  return found;
}

int rename(const char *from, const char *to) { return renameat(AT_FDCWD, from, AT_FDCWD, to); }

int unlinkat(int in, const char *name, int flags) {
  REAL(unlinkat);
  char path[MOST];
  int is_ours = counter && !(flags & AT_REMOVEDIR) && !strncmp(path_in(in, name, path), folder, strlen(folder));
  if (is_ours && event() == at && !is_kind("full") && !is_kind("short")) go();
  return real(in, name, flags);
}

int unlink(const char *path) { return unlinkat(AT_FDCWD, path, 0); }

int fsync(int file) {
  REAL(fsync);
  int found = real(file);
  if (counter && !found) synced(file);
  return found;
}

int fdatasync(int file) {
  REAL(fdatasync);
  int found = real(file);
  if (counter && !found) synced(file);
  return found;
}
