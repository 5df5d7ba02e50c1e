/* FMI 2.0 for co-simulation around motion.c. The declarations below are those that this FMU needs, written from the
 * specification of the interface (https://fmi-standard.org), so that it builds without any header of it. */
#include "motion.c"

#ifdef FMI2_FUNCTION_PREFIX /* where several FMUs are linked into one program */
#define FMI(name) JOIN(FMI2_FUNCTION_PREFIX, fmi2##name)
#else
#define FMI(name) fmi2##name
#endif

typedef enum { OK, WARNING, DISCARD, ERROR, FATAL, PENDING } Status;
typedef enum { MODEL_EXCHANGE, CO_SIMULATION } Type;
typedef int Boolean;
typedef const char *String;
typedef unsigned int Reference;
typedef struct {
    void (*logger)(void *environment, String instance, Status status, String category, String message, ...);
    void *(*allocate)(size_t count, size_t size);
    void (*release)(void *memory);
    void (*step_finished)(void *environment, Status status);
    void *environment;
} Callbacks;

typedef struct {
    Motion motion;
    Callbacks callbacks;
    char name[128];
} Instance;

static void *take(const Callbacks *own, size_t size) {
    return own->allocate ? own->allocate(1, size) : calloc(1, size);
}

static void give_back(const Callbacks *own, void *memory) {
    if (own->release) own->release(memory);
    else free(memory);
}

/* the message is text and format at once, for importers that do not format: no name and no text here has a % */
static Status tell(Instance *i, Status status, const char *message) {
    if (i->callbacks.logger)
        i->callbacks.logger(i->callbacks.environment, i->name, status, "logStatusError", message);
    return status;
}

static Status done(Instance *i, int well) { return well ? OK : tell(i, ERROR, i->motion.message); }

EXPORT String FMI(GetTypesPlatform)(void) { return "default"; }
EXPORT String FMI(GetVersion)(void) { return "2.0"; }

EXPORT Status FMI(SetDebugLogging)(void *c, Boolean on, size_t n, const String categories[]) {
    (void)c, (void)on, (void)n, (void)categories; /* errors are always told, and there is nothing else to tell */
    return OK;
}

EXPORT void *FMI(Instantiate)(String name, Type type, String token, String resources, const Callbacks *callbacks,
                              Boolean visible, Boolean logging) {
    (void)resources, (void)visible, (void)logging;
    Callbacks own = callbacks ? *callbacks : (Callbacks){0};
    const char *wrong = type != CO_SIMULATION            ? "this FMU is for co-simulation only"
                        : !token || strcmp(token, TOKEN) ? "the GUID is not that of this FMU's modelDescription.xml"
                                                         : 0;
    Instance *i = wrong ? 0 : take(&own, sizeof *i);
    if (!i) {
        if (own.logger)
            own.logger(own.environment, name ? name : "", ERROR, "logStatusError", wrong ? wrong : "no memory");
        return 0;
    }
    i->callbacks = own;
    snprintf(i->name, sizeof i->name, "%s", name ? name : "");
    begin(&i->motion);
    return i;
}

EXPORT void FMI(FreeInstance)(void *c) {
    if (c) give_back(&((Instance *)c)->callbacks, c);
}

EXPORT Status FMI(SetupExperiment)(void *c, Boolean has_tolerance, double tolerance, double start, Boolean has_stop,
                                   double stop) {
    Instance *i = c;
    (void)has_tolerance, (void)tolerance, (void)has_stop, (void)stop;
    return done(i, start_at(&i->motion, start));
}

EXPORT Status FMI(EnterInitializationMode)(void *c) { return done(c, enter_initialisation(&((Instance *)c)->motion)); }
EXPORT Status FMI(ExitInitializationMode)(void *c) { return done(c, leave_initialisation(&((Instance *)c)->motion)); }
EXPORT Status FMI(Terminate)(void *c) { return done(c, terminate(&((Instance *)c)->motion)); }

EXPORT Status FMI(Reset)(void *c) {
    begin(&((Instance *)c)->motion);
    return OK;
}

EXPORT Status FMI(GetReal)(void *c, const Reference reference[], size_t n, double value[]) {
    Instance *i = c;
    for (size_t k = 0; k < n; k++)
        if (!get(&i->motion, reference[k], value + k)) return done(i, 0);
    return OK;
}

EXPORT Status FMI(SetReal)(void *c, const Reference reference[], size_t n, const double value[]) {
    Instance *i = c;
    for (size_t k = 0; k < n; k++)
        if (!set(&i->motion, reference[k], value[k])) return done(i, 0);
    return OK;
}

EXPORT Status FMI(SetRealInputDerivatives)(void *c, const Reference reference[], size_t n, const int order[],
                                           const double value[]) {
    Instance *i = c;
    for (size_t k = 0; k < n; k++) {
        if (reference[k] < INPUTS || reference[k] >= OUTPUTS || order[k] != 1 || !isfinite(value[k]))
            return tell(i, ERROR, "only inputs have derivatives, of order 1, as finite numbers");
        i->motion.slope[reference[k] - INPUTS] = value[k];
    }
    return OK;
}

EXPORT Status FMI(DoStep)(void *c, double now, double span, Boolean no_way_back) {
    (void)no_way_back;
    return done(c, step(&((Instance *)c)->motion, now, span));
}

/* states of the FMU: copies of it */

EXPORT Status FMI(GetFMUstate)(void *c, void **state) {
    Instance *i = c;
    if (!*state) *state = take(&i->callbacks, sizeof(Motion));
    if (!*state) return tell(i, ERROR, "no memory");
    memcpy(*state, &i->motion, sizeof(Motion));
    return OK;
}

EXPORT Status FMI(SetFMUstate)(void *c, void *state) {
    memcpy(&((Instance *)c)->motion, state, sizeof(Motion));
    return OK;
}

EXPORT Status FMI(FreeFMUstate)(void *c, void **state) {
    if (*state) give_back(&((Instance *)c)->callbacks, *state);
    *state = 0;
    return OK;
}

EXPORT Status FMI(SerializedFMUstateSize)(void *c, void *state, size_t *size) {
    (void)c, (void)state;
    *size = sizeof(Motion);
    return OK;
}

EXPORT Status FMI(SerializeFMUstate)(void *c, void *state, char bytes[], size_t size) {
    if (size < sizeof(Motion)) return tell(c, ERROR, "too little room for the state");
    memcpy(bytes, state, sizeof(Motion));
    return OK;
}

EXPORT Status FMI(DeSerializeFMUstate)(void *c, const char bytes[], size_t size, void **state) {
    if (size != sizeof(Motion)) return tell(c, ERROR, "these bytes are no state of this FMU");
    if (!*state) *state = take(&((Instance *)c)->callbacks, sizeof(Motion));
    if (!*state) return tell(c, ERROR, "no memory");
    memcpy(*state, bytes, sizeof(Motion));
    return OK;
}

/* what this FMU does not have */

static Status lacking(void *c, size_t n, const char *what) { return n ? tell(c, ERROR, what) : OK; }

#define NONE_OF(type, get_type, set_type)                                                            \
    EXPORT Status FMI(Get##type)(void *c, const Reference r[], size_t n, get_type v[]) {                \
        (void)r, (void)v;                                                                               \
        return lacking(c, n, "all variables of this FMU are of type Real");                             \
    }                                                                                                   \
    EXPORT Status FMI(Set##type)(void *c, const Reference r[], size_t n, set_type v[]) {                \
        (void)r, (void)v;                                                                               \
        return lacking(c, n, "all variables of this FMU are of type Real");                             \
    }
NONE_OF(Integer, int, const int)
NONE_OF(Boolean, Boolean, const Boolean)
NONE_OF(String, String, const String)

EXPORT Status FMI(GetRealOutputDerivatives)(void *c, const Reference r[], size_t n, const int order[], double v[]) {
    (void)r, (void)order, (void)v;
    return lacking(c, n, "outputs come without derivatives");
}

EXPORT Status FMI(GetDirectionalDerivative)(void *c, const Reference z[], size_t nz, const Reference v[], size_t nv,
                                            const double dv[], double dz[]) {
    (void)z, (void)v, (void)nv, (void)dv, (void)dz;
    return lacking(c, nz, "directional derivatives are not offered");
}

EXPORT Status FMI(CancelStep)(void *c) { return tell(c, ERROR, "steps are taken at once and cannot be cancelled"); }

/* steps are never pending: only the time reached can be asked for */

EXPORT Status FMI(GetStatus)(void *c, int kind, Status *value) { (void)c, (void)kind, (void)value; return DISCARD; }
EXPORT Status FMI(GetIntegerStatus)(void *c, int kind, int *value) { (void)c, (void)kind, (void)value; return DISCARD; }
EXPORT Status FMI(GetStringStatus)(void *c, int kind, String *value) { (void)c, (void)kind, (void)value; return DISCARD; }

EXPORT Status FMI(GetRealStatus)(void *c, int kind, double *value) {
    if (kind != 2) return DISCARD; /* the last successful time */
    *value = ((Instance *)c)->motion.value[TIME];
    return OK;
}

EXPORT Status FMI(GetBooleanStatus)(void *c, int kind, Boolean *value) {
    if (kind != 3) return DISCARD; /* whether the FMU wants to end */
    (void)c;
    *value = 0;
    return OK;
}
