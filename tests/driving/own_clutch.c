/* A car with an engine and a rigid clutch, and the axle bed whose input machine acts both: equations of this file alone.
 *
 * The clutch sticks or slips by events: while it sticks, engine and hub are one inertia, and it breaks away above what it
 * can carry; while it slips, it carries that against the slip, until the slip is zero. Nothing gives way in it. Runge and
 * Kutta's classical method; tyres as in own_engine.c. Values come from Python, which reads the files. */
#include <math.h>

#define SHAPE 1.65
#define PIECES 32

typedef struct {
    double J_engine, drag_engine, J_hub, J_gear, J_diff, ratio, k_in, c_in, k_out, c_out, k_side, c_side;
    double J_wheel, J_body, drag_body, k_car, c_car, slip, peak;
    double idle_full, idle_none, idle_torque, top, top_drag;
    double J_in, drag_in, J_adapter, J_rotor, drag_rotor, k_flange, c_flange;
    double inverter[3], gain[3], lag[3], delay;
} plant;

enum { GEAR, DIFF, IN, OUT, SIDE, FRONT = SIDE + 2 };
enum { HUB = FRONT, WHEEL, BODY = WHEEL + 2, Z = BODY + 2, ENGINE = Z + 2, WHOLE };
enum { ROTOR_IN = FRONT, ADAPTER, ROTOR = ADAPTER + 2, FLANGE = ROTOR + 2, AIR = FLANGE + 2, READ = AIR + 3, BED = READ + 3 };

/* what both have: `first` turns the input shaft, `outer` the ends of the side shafts; torques of the shafts come back */
static void front(const plant *p, const double *s, double first, const double *outer, double *d, double *in, double *side)
{
    const double out = p->k_out * s[OUT] + p->c_out * (s[GEAR] / p->ratio - s[DIFF]);
    double into = out;
    *in = p->k_in * s[IN] + p->c_in * (first - s[GEAR]);
    for (int i = 0; i < 2; i++) {
        side[i] = p->k_side * s[SIDE + i] + p->c_side * (s[DIFF] - outer[i]);
        d[SIDE + i] = s[DIFF] - outer[i];
        into -= side[i];
    }
    d[GEAR] = (*in - out / p->ratio) / p->J_gear;
    d[DIFF] = into / p->J_diff;
    d[IN] = first - s[GEAR];
    d[OUT] = s[GEAR] / p->ratio - s[DIFF];
}

/* idle speed control, and the drag of an engine without fuel */
static double governed(const plant *p, double speed)
{
    if (speed < p->idle_full) return p->idle_torque;
    if (speed < p->idle_none) return p->idle_torque * (p->idle_none - speed) / (p->idle_none - p->idle_full);
    return -p->top_drag * (speed < p->top ? (speed - p->idle_none) / (p->top - p->idle_none) : 1.0);
}

/* slides: 1 the engine is faster, -1 slower, 0 it sticks; u: torques of engine and bodies, what the clutch can carry.
 * Torques of the input shaft and of the clutch come back. */
static void car_rates(const plant *p, const double *s, const double *u, int slides, double *d, double *in, double *carried)
{
    double side[2];
    front(p, s, s[HUB], s + WHEEL, d, in, side);
    const double engine = u[0] + governed(p, s[ENGINE]) - p->drag_engine * s[ENGINE];
    const double together = (engine - *in) / (p->J_engine + p->J_hub);
    *carried = slides ? slides * u[3] : engine - p->J_engine * together;
    d[ENGINE] = (engine - *carried) / p->J_engine;
    d[HUB] = (*carried - *in) / p->J_hub;
    for (int i = 0; i < 2; i++) {
        const double body = s[BODY + i], v = fabs(body), slid = s[WHEEL + i] - body;
        const double rate = (p->slip * slid - v * p->k_car * s[Z + i]) / (p->slip + v * p->c_car);
        const double linear = p->k_car * s[Z + i] + p->c_car * rate;
        const double road = p->peak * sin(SHAPE * atan(linear / (SHAPE * p->peak)));
        d[Z + i] = rate;
        d[WHEEL + i] = (side[i] - road) / p->J_wheel;
        d[BODY + i] = (road + u[1 + i] - p->drag_body * body) / p->J_body;
    }
}

static void car_step(const plant *p, double *s, const double *u, int slides, double h)
{
    double a[WHOLE], b[WHOLE], c[WHOLE], d[WHOLE], x[WHOLE], in, carried;
    car_rates(p, s, u, slides, a, &in, &carried);
    for (int i = 0; i < WHOLE; i++) x[i] = s[i] + h / 2 * a[i];
    car_rates(p, x, u, slides, b, &in, &carried);
    for (int i = 0; i < WHOLE; i++) x[i] = s[i] + h / 2 * b[i];
    car_rates(p, x, u, slides, c, &in, &carried);
    for (int i = 0; i < WHOLE; i++) x[i] = s[i] + h * c[i];
    car_rates(p, x, u, slides, d, &in, &carried);
    for (int i = 0; i < WHOLE; i++) s[i] += h / 6 * (a[i] + 2 * b[i] + 2 * c[i] + d[i]);
}

/* One piece of a sample: whether the clutch holds, and to the moment in which a slip ends and what follows. */
static int car_piece(const plant *p, double *s, const double *u, int slides, double h)
{
    double d[WHOLE], in, carried, before[WHOLE];
    if (!slides) {
        car_rates(p, s, u, 0, d, &in, &carried);
        if (fabs(carried) <= u[3]) {
            car_step(p, s, u, 0, h);
            s[HUB] = s[ENGINE];
            return 0;
        }
        slides = carried > 0 ? 1 : -1;
    }
    for (int i = 0; i < WHOLE; i++) before[i] = s[i];
    const double from = s[ENGINE] - s[HUB];
    car_step(p, s, u, slides, h);
    const double to = s[ENGINE] - s[HUB];
    if (slides * to >= 0) return slides;
    const double share = from * slides <= 0 ? 0.0 : from / (from - to);
    for (int i = 0; i < WHOLE; i++) s[i] = before[i];
    if (share > 0) car_step(p, s, u, slides, share * h);
    s[HUB] = s[ENGINE] = (p->J_engine * s[ENGINE] + p->J_hub * s[HUB]) / (p->J_engine + p->J_hub);
    car_rates(p, s, u, 0, d, &in, &carried);
    slides = fabs(carried) <= u[3] ? 0 : (carried > 0 ? 1 : -1);
    car_step(p, s, u, slides, (1 - share) * h);
    if (!slides) s[HUB] = s[ENGINE];
    return slides;
}

/* The car from a state, alone. u (n, 4): torques of the engine and of both bodies, what the clutch can carry. out (n, 7):
 * hub, engine, input shaft, left side shaft, left wheel, left body, whether it slides. */
void run_car(const plant *p, double *s, int samples, double seconds, const double *u, double *out)
{
    int slides = 0;
    for (int n = 0; n < samples; n++) {
        double *o = out + 7 * n;
        o[0] = s[HUB]; o[1] = s[ENGINE]; o[2] = p->k_in * s[IN] + p->c_in * (s[HUB] - s[GEAR]);
        o[3] = p->k_side * s[SIDE] + p->c_side * (s[DIFF] - s[WHEEL]);
        o[4] = s[WHEEL]; o[5] = s[BODY]; o[6] = slides;
        for (int i = 0; i < PIECES; i++) slides = car_piece(p, s, u + 4 * n, slides, seconds / PIECES);
    }
}

static void bed_rates(const plant *p, const double *s, const double *u, double *d)
{
    double side[2], flange[2], in;
    front(p, s, s[ROTOR_IN], s + ADAPTER, d, &in, side);
    for (int i = 0; i < 2; i++) {
        flange[i] = p->k_flange * s[FLANGE + i] + p->c_flange * (s[ADAPTER + i] - s[ROTOR + i]);
        d[FLANGE + i] = s[ADAPTER + i] - s[ROTOR + i];
        d[ADAPTER + i] = (side[i] - flange[i]) / p->J_adapter;
        d[ROTOR + i] = (flange[i] + p->gain[1 + i] * s[AIR + 1 + i] - p->drag_rotor * s[ROTOR + i]) / p->J_rotor;
    }
    d[ROTOR_IN] = (p->gain[0] * s[AIR] - p->drag_in * s[ROTOR_IN] - in) / p->J_in;
    for (int j = 0; j < 3; j++) {
        d[AIR + j] = (u[j] - s[AIR + j]) / p->inverter[j];
        d[READ + j] = ((j ? flange[j - 1] : in) - s[READ + j]) / p->lag[j];
    }
}

/* What the bed shows, exact. out (4): rotor of the input, input shaft, left side shaft, left rotor. */
void show_bed(const plant *p, const double *s, double *out)
{
    out[0] = s[ROTOR_IN]; out[1] = p->k_in * s[IN] + p->c_in * (s[ROTOR_IN] - s[GEAR]);
    out[2] = p->k_side * s[SIDE] + p->c_side * (s[DIFF] - s[ADAPTER]); out[3] = s[ROTOR];
}

/* A sample of the bed. sent (.., 3): commands, the newest first, the dead time without that of the hold. */
void step_bed(const plant *p, double *s, double seconds, const double *sent)
{
    const int whole = (int)floor(p->delay / seconds);
    const double rest = p->delay / seconds - whole;
    double a[BED], b[BED], c[BED], d[BED], x[BED];
    for (int n = 0; n < PIECES; n++) {
        const double h = seconds / PIECES, *u = sent + 3 * (whole + ((n + 0.5) / PIECES < rest ? 1 : 0));
        bed_rates(p, s, u, a);
        for (int i = 0; i < BED; i++) x[i] = s[i] + h / 2 * a[i];
        bed_rates(p, x, u, b);
        for (int i = 0; i < BED; i++) x[i] = s[i] + h / 2 * b[i];
        bed_rates(p, x, u, c);
        for (int i = 0; i < BED; i++) x[i] = s[i] + h * c[i];
        bed_rates(p, x, u, d);
        for (int i = 0; i < BED; i++) s[i] += h / 6 * (a[i] + 2 * b[i] + 2 * c[i] + d[i]);
    }
}
