/* A car beyond its side shafts as an FMU of FMI 2.0 for co-simulation: equations and interface of this file alone.
 *
 * Two sides, each wheel, belt, carcass with a contact patch under the Magic Formula, body, air, rolling resistance and a
 * brake of dry friction (Pacejka, Tire and Vehicle Dynamics, 3rd ed. 2012). Runge and Kutta's classical method, steps of
 * 1/32 ms. What can go wrong with an FMU is asked for by the input `wrong`: 1 crash, 2 hang, 3 not a number, 4 error. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { TORQUE, BRAKE = 2, WRONG = 4, WHEEL, INPUTS_AND_OUTPUTS = 7 };
enum { W, T, B, BELT, Z, PAD, STATES };

#ifndef MASSLESS
#define MASSLESS 0 /* 1: the wheel has no inertia, its speed follows the torque at once */
#endif
#ifndef BODY
#define BODY 90.1
#endif
#ifndef CRASHES
#define CRASHES 1e300 /* s after which it ends its process */
#endif
#ifndef SLIP
#define SLIP 7200.0
#endif

typedef struct {
    double value[INPUTS_AND_OUTPUTS], state[2][STATES];
} vehicle;

static void rates(const double *s, double torque, double brake, double *d)
{
    const double v = fabs(s[B]), belt = 1.18e5 * s[BELT] + 50.0 * (s[W] - s[T]);
    const double z = (SLIP * (s[T] - s[B]) - v * 3.0e4 * s[Z]) / (SLIP + v * 300.0);
    const double road = 1080.0 * sin(1.65 * atan((3.0e4 * s[Z] + 300.0 * z) / (1.65 * 1080.0)));
    const double pad = s[W] - fabs(s[W]) * s[PAD] / 0.02;
    const double held = brake * (s[PAD] + 0.002 * pad) / 0.02;
    d[W] = (torque - belt - held) / 0.69;
    d[T] = (belt - road) / 0.456;
    d[B] = (road - 0.0053 * s[B] * v - 29.0 * tanh(s[B] / 0.02) - 0.05 * s[B]) / BODY;
    d[BELT] = s[W] - s[T];
    d[Z] = z;
    d[PAD] = pad;
}

static void go_on(double *s, double torque, double brake, double span)
{
    const int pieces = (int)ceil(span * 32e3 - 1e-9);
    const double h = span / pieces;
    for (int n = 0; n < pieces; n++) {
        double a[STATES], b[STATES], c[STATES], d[STATES], x[STATES];
        rates(s, torque, brake, a);
        for (int i = 0; i < STATES; i++) x[i] = s[i] + h / 2 * a[i];
        rates(x, torque, brake, b);
        for (int i = 0; i < STATES; i++) x[i] = s[i] + h / 2 * b[i];
        rates(x, torque, brake, c);
        for (int i = 0; i < STATES; i++) x[i] = s[i] + h * c[i];
        rates(x, torque, brake, d);
        for (int i = 0; i < STATES; i++) s[i] += h / 6 * (a[i] + 2 * b[i] + 2 * c[i] + d[i]);
    }
}

const char *fmi2GetTypesPlatform(void) { return "default"; }
const char *fmi2GetVersion(void) { return "2.0"; }
int fmi2SetDebugLogging(void *c, int on, size_t n, const char *const *names)
{
    (void)c, (void)on, (void)n, (void)names;
    return 0;
}
void *fmi2Instantiate(const char *name, int kind, const char *guid, const char *folder, const void *calls, int visible, int log)
{
    (void)name, (void)kind, (void)guid, (void)folder, (void)calls, (void)visible, (void)log;
    return calloc(1, sizeof(vehicle));
}
void fmi2FreeInstance(void *c) { free(c); }
int fmi2SetupExperiment(void *c, int a, double b, double d, int e, double f)
{
    (void)c, (void)a, (void)b, (void)d, (void)e, (void)f;
    return 0;
}
int fmi2EnterInitializationMode(void *c) { (void)c; return 0; }
int fmi2ExitInitializationMode(void *c) { (void)c; return 0; }
int fmi2Terminate(void *c) { (void)c; return 0; }
int fmi2Reset(void *c) { memset(c, 0, sizeof(vehicle)); return 0; }
int fmi2SetReal(void *c, const unsigned *reference, size_t n, const double *value)
{
    for (size_t i = 0; i < n; i++) ((vehicle *)c)->value[reference[i]] = value[i];
    return 0;
}
int fmi2GetReal(void *c, const unsigned *reference, size_t n, double *value)
{
    for (size_t i = 0; i < n; i++) value[i] = ((vehicle *)c)->value[reference[i]];
    return 0;
}
int fmi2DoStep(void *c, double now, double span, int no_set)
{
    vehicle *own = c;
    (void)no_set;
    if (own->value[WRONG] == 1 || now > CRASHES) abort();
    while (own->value[WRONG] == 2) { now += 1; }
    if (own->value[WRONG] == 4) return 3;
    for (int i = 0; i < 2; i++) {
        go_on(own->state[i], own->value[TORQUE + i], own->value[BRAKE + i], span);
        own->value[WHEEL + i] = own->state[i][W];
        if (MASSLESS) own->value[WHEEL + i] = own->state[i][B] + own->value[TORQUE + i] / 250.0;
        if (own->value[WRONG] == 3) own->value[WHEEL + i] = NAN;
    }
    return 0;
}

/* the standard wants them all; nobody calls them */
#define NOT_USED(name) int fmi2##name(void) { return 3; }
NOT_USED(CancelStep) NOT_USED(DeSerializeFMUstate) NOT_USED(FreeFMUstate) NOT_USED(GetBoolean) NOT_USED(GetBooleanStatus)
NOT_USED(GetDirectionalDerivative) NOT_USED(GetFMUstate) NOT_USED(GetInteger) NOT_USED(GetIntegerStatus)
NOT_USED(GetRealOutputDerivatives) NOT_USED(GetRealStatus) NOT_USED(GetStatus) NOT_USED(GetString) NOT_USED(GetStringStatus)
NOT_USED(SerializeFMUstate) NOT_USED(SerializedFMUstateSize) NOT_USED(SetBoolean) NOT_USED(SetFMUstate)
NOT_USED(SetInteger) NOT_USED(SetRealInputDerivatives) NOT_USED(SetString)
