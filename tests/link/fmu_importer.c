/* An importer that is no Python: loads the binary of an FMU (FMI 3), makes an instance and steps it once.
   fmu_importer BINARY TOKEN RESOURCES */
#include <dlfcn.h>
#include <stdbool.h>
#include <stdio.h>

typedef void *Instance;
typedef int Status;

static void tell(void *e, Status s, const char *category, const char *message) {
    printf("log: %s\n", message);
}

int main(int argc, char **argv) {
    void *library = dlopen(argv[1], RTLD_LAZY | RTLD_LOCAL);
    if (!library) { printf("%s\n", dlerror()); return 2; }
    Instance (*make)(const char *, const char *, const char *, bool, bool, bool, bool, const unsigned *, size_t,
                     void *, void *, void *) = dlsym(library, "fmi3InstantiateCoSimulation");
    Status (*enter)(Instance, bool, double, double, bool, double) = dlsym(library, "fmi3EnterInitializationMode");
    Status (*leave)(Instance) = dlsym(library, "fmi3ExitInitializationMode");
    Status (*step)(Instance, double, double, bool, bool *, bool *, bool *, double *) = dlsym(library, "fmi3DoStep");
    Instance one = make("one", argv[2], argv[3], false, false, false, false, NULL, 0, NULL, (void *)tell, NULL);
    if (!one) { printf("no instance\n"); return 3; }
    Status entered = enter(one, false, 0.0, 0.0, false, 0.0), left = leave(one);
    bool event, ended, early;
    double last;
    Status stepped = step(one, 0.0, 0.1, true, &event, &ended, &early, &last);
    printf("status %d %d %d\n", entered, left, stepped);
    return 0;
}
