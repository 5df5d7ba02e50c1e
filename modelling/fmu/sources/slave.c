/* What both kinds of motion have alike: why a call failed, and the phases of a slave's life. Included where Motion is known. */

static int advance(Motion *m, double span);

static int fail(Motion *m, const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(m->message, MESSAGE, format, arguments);
    va_end(arguments);
    return 0;
}

static int known(Motion *m, unsigned reference) {
    return reference < N_VALUES || fail(m, "no variable has the value reference %u; there are %d", reference, N_VALUES);
}

/* the phases of a slave's life */

static int to_phase(Motion *m, Phase from, Phase to, const char *otherwise) {
    if (m->phase != from) return fail(m, "%s", otherwise);
    m->phase = to;
    return 1;
}

static int enter_initialisation(Motion *m) {
    return to_phase(m, INSTANTIATED, INITIALISING, "initialisation begins after instantiation or reset only");
}

static int leave_initialisation(Motion *m) {
    return to_phase(m, INITIALISING, STEPPING, "initialisation has not begun");
}

static int terminate(Motion *m) { return to_phase(m, STEPPING, TERMINATED, "nothing runs that could be terminated"); }

static int start_at(Motion *m, double time) {
    if (m->phase != INSTANTIATED) return fail(m, "the start time is given before initialisation");
    if (!isfinite(time)) return fail(m, "the start time is not a finite number");
    m->value[TIME] = time;
    return 1;
}

static int step(Motion *m, double now, double span) {
    double own = m->value[TIME];
    if (m->phase != STEPPING) return fail(m, "a step needs initialisation to be over, and no termination");
    if (!(fabs(now - own) <= 1e-9 * fmax(1, fabs(own))))
        return fail(m, "the step begins at %.9g s, but the last one ended at %.9g s", now, own);
    return advance(m, span);
}
