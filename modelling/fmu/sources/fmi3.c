/* FMI 3.0 for co-simulation around motion.c. The declarations below are those that this FMU needs, written from the
 * specification of the interface (https://fmi-standard.org), so that it builds without any header of it. */
#include <stdbool.h>
#include <stdint.h>

#include "motion.c"

#ifdef FMI3_FUNCTION_PREFIX /* where several FMUs are linked into one program */
#define FMI(name) JOIN(FMI3_FUNCTION_PREFIX, fmi3##name)
#else
#define FMI(name) fmi3##name
#endif

typedef enum { OK, WARNING, DISCARD, ERROR, FATAL } Status;
typedef const char *String;
typedef uint32_t Reference;
typedef const uint8_t *Binary;
typedef void (*Logger)(void *environment, Status status, String category, String message);
typedef void (*Unused)(void); /* callbacks that are never called */

typedef struct {
    Motion motion;
    Logger logger;
    void *environment;
} Instance;

static Status tell(Instance *i, Status status, const char *message) {
    if (i->logger) i->logger(i->environment, status, "logStatusError", message);
    return status;
}

static Status done(Instance *i, int well) { return well ? OK : tell(i, ERROR, i->motion.message); }

EXPORT String FMI(GetVersion)(void) { return "3.0"; }

EXPORT Status FMI(SetDebugLogging)(void *c, bool on, size_t n, const String categories[]) {
    (void)c, (void)on, (void)n, (void)categories; /* errors are always told, and there is nothing else to tell */
    return OK;
}

static void *refuse(Logger logger, void *environment, const char *message) {
    if (logger) logger(environment, ERROR, "logStatusError", message);
    return 0;
}

EXPORT void *FMI(InstantiateCoSimulation)(String name, String token, String resources, bool visible, bool logging,
                                          bool events, bool early_return, const Reference intermediate[], size_t n,
                                          void *environment, Logger logger, Unused intermediate_update) {
    (void)name, (void)resources, (void)visible, (void)logging, (void)events, (void)early_return;
    (void)intermediate, (void)n, (void)intermediate_update;
    if (!token || strcmp(token, TOKEN))
        return refuse(logger, environment, "the token is not that of this FMU's modelDescription.xml");
    Instance *i = calloc(1, sizeof *i);
    if (!i) return refuse(logger, environment, "no memory");
    i->logger = logger;
    i->environment = environment;
    begin(&i->motion);
    return i;
}

EXPORT void *FMI(InstantiateModelExchange)(String name, String token, String resources, bool visible, bool logging,
                                           void *environment, Logger logger) {
    (void)name, (void)token, (void)resources, (void)visible, (void)logging;
    return refuse(logger, environment, "this FMU is for co-simulation only");
}

EXPORT void *FMI(InstantiateScheduledExecution)(String name, String token, String resources, bool visible, bool logging,
                                                void *environment, Logger logger, Unused clock, Unused lock,
                                                Unused unlock) {
    (void)name, (void)token, (void)resources, (void)visible, (void)logging, (void)clock, (void)lock, (void)unlock;
    return refuse(logger, environment, "this FMU is for co-simulation only");
}

EXPORT void FMI(FreeInstance)(void *c) { free(c); }

EXPORT Status FMI(EnterInitializationMode)(void *c, bool has_tolerance, double tolerance, double start, bool has_stop,
                                           double stop) {
    Motion *m = &((Instance *)c)->motion;
    (void)has_tolerance, (void)tolerance, (void)has_stop, (void)stop;
    return done(c, start_at(m, start) && enter_initialisation(m));
}

EXPORT Status FMI(ExitInitializationMode)(void *c) { return done(c, leave_initialisation(&((Instance *)c)->motion)); }
EXPORT Status FMI(Terminate)(void *c) { return done(c, terminate(&((Instance *)c)->motion)); }

EXPORT Status FMI(Reset)(void *c) {
    begin(&((Instance *)c)->motion);
    return OK;
}

EXPORT Status FMI(GetFloat64)(void *c, const Reference reference[], size_t n, double value[], size_t room) {
    Instance *i = c;
    if (room < n) return tell(i, ERROR, "there is less room than there are variables");
    for (size_t k = 0; k < n; k++)
        if (!get(&i->motion, reference[k], value + k)) return done(i, 0);
    return OK;
}

EXPORT Status FMI(SetFloat64)(void *c, const Reference reference[], size_t n, const double value[], size_t given) {
    Instance *i = c;
    if (given < n) return tell(i, ERROR, "there are fewer values than variables");
    for (size_t k = 0; k < n; k++)
        if (!set(&i->motion, reference[k], value[k])) return done(i, 0);
    return OK;
}

EXPORT Status FMI(DoStep)(void *c, double now, double span, bool no_way_back, bool *event, bool *terminated,
                          bool *early_return, double *reached) {
    Motion *m = &((Instance *)c)->motion;
    (void)no_way_back;
    Status status = done(c, step(m, now, span));
    *event = *terminated = *early_return = false;
    *reached = m->value[TIME];
    return status;
}

/* states of the FMU: copies of the motion */

EXPORT Status FMI(GetFMUState)(void *c, void **state) {
    if (!*state) *state = malloc(sizeof(Motion));
    if (!*state) return tell(c, ERROR, "no memory");
    memcpy(*state, &((Instance *)c)->motion, sizeof(Motion));
    return OK;
}

EXPORT Status FMI(SetFMUState)(void *c, void *state) {
    memcpy(&((Instance *)c)->motion, state, sizeof(Motion));
    return OK;
}

EXPORT Status FMI(FreeFMUState)(void *c, void **state) {
    (void)c;
    free(*state);
    *state = 0;
    return OK;
}

EXPORT Status FMI(SerializedFMUStateSize)(void *c, void *state, size_t *size) {
    (void)c, (void)state;
    *size = sizeof(Motion);
    return OK;
}

EXPORT Status FMI(SerializeFMUState)(void *c, void *state, uint8_t bytes[], size_t size) {
    if (size < sizeof(Motion)) return tell(c, ERROR, "too little room for the state");
    memcpy(bytes, state, sizeof(Motion));
    return OK;
}

EXPORT Status FMI(DeserializeFMUState)(void *c, const uint8_t bytes[], size_t size, void **state) {
    if (size != sizeof(Motion)) return tell(c, ERROR, "these bytes are no state of this FMU");
    if (!*state) *state = malloc(sizeof(Motion));
    if (!*state) return tell(c, ERROR, "no memory");
    memcpy(*state, bytes, sizeof(Motion));
    return OK;
}

/* what this FMU does not have, though every FMU has to export it */

static const char *const OTHER_TYPE = "all variables of this FMU are of type Float64";
static const char *const NO_CLOCKS = "this FMU has no clocks and no partitions";
static const char *const NO_MODE = "this FMU knows no such mode: it is for co-simulation without events";
static const char *const NO_DERIVATIVES = "this FMU offers no derivatives";

#define LACKS0(why, name) EXPORT Status FMI(name)(void *c) { return tell(c, ERROR, why); }
#define LACKS1(why, name, A) EXPORT Status FMI(name)(void *c, A d) { return (void)d, tell(c, ERROR, why); }
#define LACKS2(why, name, A, B) \
    EXPORT Status FMI(name)(void *c, A d, B e) { return (void)d, (void)e, tell(c, ERROR, why); }
#define LACKS3(why, name, A, B, C) \
    EXPORT Status FMI(name)(void *c, A d, B e, C f) { return (void)d, (void)e, (void)f, tell(c, ERROR, why); }
#define LACKS4(why, name, A, B, C, D)                          \
    EXPORT Status FMI(name)(void *c, A d, B e, C f, D g) {     \
        return (void)d, (void)e, (void)f, (void)g, tell(c, ERROR, why); \
    }
#define LACKS5(why, name, A, B, C, D, E)                       \
    EXPORT Status FMI(name)(void *c, A d, B e, C f, D g, E h) { \
        return (void)d, (void)e, (void)f, (void)g, (void)h, tell(c, ERROR, why); \
    }
#define LACKS6(why, name, A, B, C, D, E, F)                    \
    EXPORT Status FMI(name)(void *c, A d, B e, C f, D g, E h, F i) { \
        return (void)d, (void)e, (void)f, (void)g, (void)h, (void)i, tell(c, ERROR, why); \
    }
#define LACKS8(why, name, A, B, C, D, E, F, G, H)              \
    EXPORT Status FMI(name)(void *c, A d, B e, C f, D g, E h, F i, G j, H k) { \
        return (void)d, (void)e, (void)f, (void)g, (void)h, (void)i, (void)j, (void)k, tell(c, ERROR, why); \
    }

typedef const Reference *References;

#define TYPE(name, type)                                                      \
    LACKS4(OTHER_TYPE, Get##name, References, size_t, type *, size_t)         \
    LACKS4(OTHER_TYPE, Set##name, References, size_t, const type *, size_t)
TYPE(Float32, float)
TYPE(Int8, int8_t)
TYPE(UInt8, uint8_t)
TYPE(Int16, int16_t)
TYPE(UInt16, uint16_t)
TYPE(Int32, int32_t)
TYPE(UInt32, uint32_t)
TYPE(Int64, int64_t)
TYPE(UInt64, uint64_t)
TYPE(Boolean, bool)
TYPE(String, String)
LACKS5(OTHER_TYPE, GetBinary, References, size_t, size_t *, Binary *, size_t)
LACKS5(OTHER_TYPE, SetBinary, References, size_t, const size_t *, const Binary *, size_t)
LACKS3(NO_CLOCKS, GetClock, References, size_t, bool *)
LACKS3(NO_CLOCKS, SetClock, References, size_t, const bool *)

LACKS4(NO_CLOCKS, GetIntervalDecimal, References, size_t, double *, int *)
LACKS5(NO_CLOCKS, GetIntervalFraction, References, size_t, uint64_t *, uint64_t *, int *)
LACKS3(NO_CLOCKS, GetShiftDecimal, References, size_t, double *)
LACKS4(NO_CLOCKS, GetShiftFraction, References, size_t, uint64_t *, uint64_t *)
LACKS3(NO_CLOCKS, SetIntervalDecimal, References, size_t, const double *)
LACKS4(NO_CLOCKS, SetIntervalFraction, References, size_t, const uint64_t *, const uint64_t *)
LACKS3(NO_CLOCKS, SetShiftDecimal, References, size_t, const double *)
LACKS4(NO_CLOCKS, SetShiftFraction, References, size_t, const uint64_t *, const uint64_t *)
LACKS2(NO_CLOCKS, ActivateModelPartition, Reference, double)

LACKS0(NO_MODE, EnterConfigurationMode)
LACKS0(NO_MODE, ExitConfigurationMode)
LACKS0(NO_MODE, EnterEventMode)
LACKS0(NO_MODE, EnterStepMode)
LACKS0(NO_MODE, EnterContinuousTimeMode)
LACKS0(NO_MODE, EvaluateDiscreteStates)
LACKS6(NO_MODE, UpdateDiscreteStates, bool *, bool *, bool *, bool *, bool *, double *)
LACKS3(NO_MODE, CompletedIntegratorStep, bool, bool *, bool *)
LACKS1(NO_MODE, SetTime, double)
LACKS2(NO_MODE, SetContinuousStates, const double *, size_t)
LACKS2(NO_MODE, GetContinuousStateDerivatives, double *, size_t)
LACKS2(NO_MODE, GetEventIndicators, double *, size_t)
LACKS2(NO_MODE, GetContinuousStates, double *, size_t)
LACKS2(NO_MODE, GetNominalsOfContinuousStates, double *, size_t)
LACKS1(NO_MODE, GetNumberOfEventIndicators, size_t *)
LACKS1(NO_MODE, GetNumberOfContinuousStates, size_t *)

LACKS8(NO_DERIVATIVES, GetDirectionalDerivative, References, size_t, References, size_t, const double *, size_t,
       double *, size_t)
LACKS8(NO_DERIVATIVES, GetAdjointDerivative, References, size_t, References, size_t, const double *, size_t, double *,
       size_t)
LACKS5(NO_DERIVATIVES, GetOutputDerivatives, References, size_t, const int32_t *, double *, size_t)
LACKS2(NO_DERIVATIVES, GetNumberOfVariableDependencies, Reference, size_t *)
LACKS6(NO_DERIVATIVES, GetVariableDependencies, Reference, size_t *, Reference *, size_t *, int *, size_t)
