/* A car with an engine and its axle bed side by side, the bed under an exported controller: equations of this file alone.
 *
 * Nothing of rigmatch is used but the controller under test. Runge and Kutta's classical method, 24 steps a millisecond;
 * noise, lags, a dead time that is no whole number of samples. The engine gives its demand, or what its torque map has for
 * a pedal, pulses over its own angle and drag; below idle a governor adds torque. Tyres: contact patch with a relaxation length under the Magic Formula
 * (Pacejka, Tire and Vehicle Dynamics, 3rd ed. 2012, sections 4.3, 7.2). Values come from Python, which reads the files. */
#include <math.h>
#include <string.h>

#include "controller.h"

#define SHAPE 1.65
#define PIECES 24
#define LONGEST 64 /* samples of dead time at most */
#define MOST 8
#define TWO_PI 6.283185307179586

typedef struct {
    double J_engine, drag_engine, J_gear, J_diff, ratio, k_in, c_in, k_out, c_out, k_side, c_side;
    double J_wheel, J_body, drag_body, k_car, c_car, slip, peak;
    double order, pulse, phase, idle_full, idle_none, idle_torque, top, top_drag;
    double J_in, drag_in, J_adapter, J_rotor, drag_rotor, k_flange, c_flange;
    double inverter[3], gain[3], lag[3], delay, noise_torque[3], noise_speed[3];
    double speeds, pedals, map_speed[MOST], map_pedal[MOST], map[MOST * MOST]; /* of a torque map; none with 0 speeds */
} plant;

enum { GEAR, DIFF, IN, OUT, SIDE, FRONT = SIDE + 2 };
enum { ENGINE = FRONT, TURNED, WHEEL, BODY = WHEEL + 2, CAR = BODY + 2, Z = CAR, WHOLE = Z + 2 };
enum { ROTOR_IN = FRONT, ANGLE, ADAPTER, ROTOR = ADAPTER + 2, FLANGE = ROTOR + 2, AIR = FLANGE + 2, READ = AIR + 3, BED = READ + 3 };

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

/* where a value lies between two points of an axis, held at its ends */
static double between(const double *axis, int count, double at, int *low)
{
    int i = 0;
    while (i < count - 2 && at > axis[i + 1]) i++;
    *low = i;
    const double share = (at - axis[i]) / (axis[i + 1] - axis[i]);
    return share < 0.0 ? 0.0 : share > 1.0 ? 1.0 : share;
}

/* what the engine gives for its demand: itself, or the torque that its map has for a pedal */
static double given(const plant *p, double demand, double speed)
{
    if (p->speeds < 1) return demand;
    int i, j;
    const double a = between(p->map_speed, (int)p->speeds, speed, &i), b = between(p->map_pedal, (int)p->pedals, demand, &j);
    const double *low = p->map + i * (int)p->pedals + j, *high = low + (int)p->pedals;
    return (1 - a) * ((1 - b) * low[0] + b * low[1]) + a * ((1 - b) * high[0] + b * high[1]);
}

static void car_rates(const plant *p, const double *s, const double *u, double *d, double *in)
{
    double side[2];
    front(p, s, s[ENGINE], s + WHEEL, d, in, side);
    d[TURNED] = s[ENGINE];
    d[ENGINE] = (given(p, u[0], s[ENGINE]) + governed(p, s[ENGINE]) + p->pulse * sin(p->order * s[TURNED] + p->phase) - p->drag_engine * s[ENGINE] - *in) / p->J_engine;
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

static void bed_rates(const plant *p, const double *s, const double *u, double *d, double *in)
{
    double side[2], flange[2];
    front(p, s, s[ROTOR_IN], s + ADAPTER, d, in, side);
    for (int i = 0; i < 2; i++) {
        flange[i] = p->k_flange * s[FLANGE + i] + p->c_flange * (s[ADAPTER + i] - s[ROTOR + i]);
        d[FLANGE + i] = s[ADAPTER + i] - s[ROTOR + i];
        d[ADAPTER + i] = (side[i] - flange[i]) / p->J_adapter;
        d[ROTOR + i] = (flange[i] + p->gain[1 + i] * s[AIR + 1 + i] - p->drag_rotor * s[ROTOR + i]) / p->J_rotor;
    }
    d[ANGLE] = s[ROTOR_IN];
    d[ROTOR_IN] = (p->gain[0] * s[AIR] - p->drag_in * s[ROTOR_IN] - *in) / p->J_in;
    for (int j = 0; j < 3; j++) {
        d[AIR + j] = (u[j] - s[AIR + j]) / p->inverter[j];
        d[READ + j] = ((j ? flange[j - 1] : *in) - s[READ + j]) / p->lag[j];
    }
}

typedef void (*rates_of_plant)(const plant *, const double *, const double *, double *, double *);

static double step(rates_of_plant rates, int n, const plant *p, double *s, const double *u, double h)
{
    double a[BED], b[BED], c[BED], d[BED], x[BED], torque, other;
    rates(p, s, u, a, &torque);
    for (int i = 0; i < n; i++) x[i] = s[i] + h / 2 * a[i];
    rates(p, x, u, b, &other);
    for (int i = 0; i < n; i++) x[i] = s[i] + h / 2 * b[i];
    rates(p, x, u, c, &other);
    for (int i = 0; i < n; i++) x[i] = s[i] + h * c[i];
    rates(p, x, u, d, &other);
    for (int i = 0; i < n; i++) s[i] += h / 6 * (a[i] + 2 * b[i] + 2 * c[i] + d[i]);
    return torque;
}

/* The car from a state, alone. u (n, 3): torques of the engine and of both bodies. out (n, 6): engine, angle, input shaft,
 * left side shaft, left wheel, left body. */
void run_car(const plant *p, double *s, int samples, const double *u, double *out)
{
    for (int n = 0; n < samples; n++) {
        double torque = 0.0;
        const double angle = s[TURNED];
        const double engine = s[ENGINE];
        for (int i = 0; i < PIECES; i++) {
            const double now = step(car_rates, WHOLE, p, s, u + 3 * n, 1e-3 / PIECES);
            if (i == 0) torque = now;
        }
        double *o = out + 6 * n;
        o[0] = engine; o[1] = angle; o[2] = torque; o[3] = p->k_side * s[SIDE]; o[4] = s[WHEEL]; o[5] = s[BODY];
    }
}

/* The bed: held at speeds (3) for `held` samples, then emulation. noise (n, 6) standard normal. known (n, K) in the order of
 * the controller. out (n, 8): rotor of the input, angle, input shaft, left side shaft, left rotor, commands of the machines.
 * The result is the sample in which emulation ended, or -1. */
int run_bed(const plant *p, double *s, int samples, int held, const double *hold, const double *known, const double *noise, double *out)
{
    static controller c;
    controller_input in;
    controller_output got;
    double sent[LONGEST][3];
    const int whole = (int)floor(p->delay / 1e-3);
    const double rest = p->delay / 1e-3 - whole;
    int ended = -1;
    memset(&in, 0, sizeof in);
    memset(sent, 0, sizeof sent);
    controller_init(&c);
    for (int n = 0; n < samples; n++) {
        for (int j = 0; j < 3; j++) {
            in.reading[j] = s[READ + j] + p->noise_torque[j] * noise[6 * n + j];
            in.reading[3 + j] = (j ? s[ROTOR + j - 1] : s[ROTOR_IN]) + p->noise_speed[j] * noise[6 * n + 3 + j];
            in.hold_speed[j] = hold[j];
        }
        for (int i = 0; i < CONTROLLER_KNOWN; i++) in.known[i] = known[n * CONTROLLER_KNOWN + i];
        in.mode = n < held ? CONTROLLER_SPEED_HOLD : CONTROLLER_EMULATION;
        in.life = (uint32_t)n;
        controller_step(&c, &in, &got);
        if (n > held && got.fault && ended < 0) ended = n;
        memmove(sent[1], sent[0], sizeof sent - sizeof sent[0]);
        double *o = out + 8 * n;
        for (int j = 0; j < 3; j++) o[5 + j] = sent[0][j] = got.command[j];
        o[0] = s[ROTOR_IN]; o[1] = s[ANGLE]; o[3] = p->k_side * s[SIDE]; o[4] = s[ROTOR];
        for (int i = 0; i < PIECES; i++) {
            const double *acting = sent[whole + ((i + 0.5) / PIECES < rest ? 1 : 0)];
            const double now = step(bed_rates, BED, p, s, acting, 1e-3 / PIECES);
            if (i == 0) o[2] = now;
        }
    }
    return ended;
}

int known_torques(void) { return CONTROLLER_KNOWN; }
