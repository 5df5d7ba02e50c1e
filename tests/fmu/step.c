/* Times the steps of an FMI 2.0 FMU and counts what they allocate.
 *
 *   step LIBRARY GUID INPUTS OUTPUTS STEPS SPAN -> mean, median, 99.9 % and largest time of a step in µs,
 *                                                   allocations during the steps, allocations before
 *
 * A step is what a real-time system does in one: set all inputs, step, get all outputs. Inputs have the value references
 * 1 … INPUTS, outputs those that follow.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

extern void *__libc_malloc(size_t), *__libc_calloc(size_t, size_t), *__libc_realloc(void *, size_t);
static long allocated;
void *malloc(size_t n) { return allocated++, __libc_malloc(n); }
void *calloc(size_t n, size_t m) { return allocated++, __libc_calloc(n, m); }
void *realloc(void *p, size_t n) { return allocated++, __libc_realloc(p, n); }

static int rising(const void *a, const void *b) {
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return 1e6 * (double)t.tv_sec + 1e-3 * (double)t.tv_nsec;
}

int main(int count, char **word) {
    if (count != 7) return 2;
    void *library = dlopen(word[1], RTLD_NOW | RTLD_LOCAL);
    if (!library) return fprintf(stderr, "%s\n", dlerror()), 1;
    void *(*instantiate)(const char *, int, const char *, const char *, void *, int, int) =
        dlsym(library, "fmi2Instantiate");
    int (*setup)(void *, int, double, double, int, double) = dlsym(library, "fmi2SetupExperiment");
    int (*enter)(void *) = dlsym(library, "fmi2EnterInitializationMode");
    int (*leave)(void *) = dlsym(library, "fmi2ExitInitializationMode");
    int (*set)(void *, const unsigned *, size_t, const double *) = dlsym(library, "fmi2SetReal");
    int (*get)(void *, const unsigned *, size_t, double *) = dlsym(library, "fmi2GetReal");
    int (*step)(void *, double, double, int) = dlsym(library, "fmi2DoStep");
    void (*release)(void *) = dlsym(library, "fmi2FreeInstance");
    int inputs = atoi(word[3]), outputs = atoi(word[4]), steps = atoi(word[5]);
    double span = atof(word[6]), u[64] = {0}, y[64], *taken = malloc(sizeof(double) * (size_t)steps), sum = 0;
    unsigned reference[128];
    for (unsigned i = 0; i < 128; i++) reference[i] = i + 1;
    long early = allocated;
    void *slave = instantiate("one", 1, word[2], "", 0, 0, 0);
    if (!slave || !taken || inputs > 64 || outputs > 64) return 1;
    int bad = setup(slave, 0, 0, 0, 0, 0) | enter(slave) | leave(slave);
    double t = 0;
    long before = allocated;
    for (int k = 0; k < steps; k++) {
        for (int i = 0; i < inputs; i++) u[i] = 100 * sin(10 * t + i);
        double begun = now();
        bad |= set(slave, reference, (size_t)inputs, u);
        bad |= step(slave, t, span, 1);
        bad |= get(slave, reference + inputs, (size_t)outputs, y);
        taken[k] = now() - begun;
        t += span;
    }
    long during = allocated - before;
    release(slave);
    if (bad) return fprintf(stderr, "a call failed\n"), 1;
    for (int k = 0; k < steps; k++) sum += taken[k];
    qsort(taken, (size_t)steps, sizeof *taken, rising);
    printf("%.4f %.4f %.4f %.4f %ld %ld\n", sum / steps, taken[steps / 2], taken[(long)steps * 999 / 1000],
           taken[steps - 1], during, before - early);
    return 0;
}
