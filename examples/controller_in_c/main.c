/* Closes the loop of an exported controller of examples/road_to_rig with a bed of seven inertias: speed hold, then emulation with a
 * tip-in. Prints mode, readings, known torques and commands of every sample. Needs controller.h, controller.c, controller_data.h. */
#include <stdio.h>
#include "controller.h"

#define SAMPLES 4000
#define FINE 100    /* steps of the bed a sample: 10 us */
#define LATE 250    /* of these from a sample until its commands act: 3 ms dead time less the half sample of hold */
#define LAG 0.002   /* s, of the inverters; torque sensors: 0.5 ms */
#define TIP_IN 20.0 /* N*m */
enum { MOTOR, GEARBOX, DIFFERENTIAL, ADAPTER_L, ADAPTER_R, ROTOR_L, ROTOR_R, INERTIAS };
enum { MESH, OUTPUT, SIDE_L, SIDE_R, FLANGE_L, FLANGE_R, SHAFTS };
static const double J[] = {0.0493, 0.0099, 0.05, 0.05, 0.05, 0.895, 0.895}, drag[] = {0.005, 0, 0, 0, 0, 0.1, 0.1};
static const int from[] = {MOTOR, GEARBOX, DIFFERENTIAL, DIFFERENTIAL, ADAPTER_L, ADAPTER_R};
static const int to[] = {GEARBOX, DIFFERENTIAL, ADAPTER_L, ADAPTER_R, ROTOR_L, ROTOR_R};
static const double ratio[] = {1, 10.05, 1, 1, 1, 1}, stiffness[] = {1710, 4.12e5, 1.092e4, 1.092e4, 2e5, 2e5};
static const double damping[] = {0.3, 20, 4, 4, 20, 20};

int main(void)
{
    static controller c;
    static double sent[SAMPLES][2];
    double speed[INERTIAS], twist[SHAFTS] = {0}, torque[SHAFTS] = {0}, flange[2] = {0}, air_gap[2] = {0};
    const double dt = CONTROLLER_SAMPLE_TIME / FINE;
    for (int i = 0; i < INERTIAS; i++)
        speed[i] = i < DIFFERENTIAL ? 301.5 : 30.0;
    controller_init(&c);
    for (int n = 0; n < SAMPLES; n++) {
        const double motor = n < 2200 ? 0.0 : n < 2250 ? TIP_IN * (n - 2200) / 50 : TIP_IN;
        controller_input in = {.reading = {flange[0], flange[1], speed[ROTOR_L], speed[ROTOR_R]},
                               .known = {motor}, .hold_speed = {30, 30}, .life = (uint32_t)n,
                               .mode = n < 1000 ? CONTROLLER_SPEED_HOLD : CONTROLLER_EMULATION};
        controller_output out;
        controller_step(&c, &in, &out);
        printf("%d %d", (int)out.mode, (int)out.fault);
        for (int i = 0; i < CONTROLLER_READINGS; i++)
            printf(" %.17g", in.reading[i]);
        printf(" %.17g %.17g %.17g %.17g\n", motor, out.command[0], out.command[1], speed[MOTOR]);
        sent[n][0] = out.command[0], sent[n][1] = out.command[1];
        for (int i = 0; i < FINE; i++) {
            const int acts = n * FINE + i < LATE ? -1 : (n * FINE + i - LATE) / FINE;
            double sum[INERTIAS] = {[MOTOR] = motor, [ROTOR_L] = air_gap[0], [ROTOR_R] = air_gap[1]};
            for (int s = 0; s < SHAFTS; s++) {
                const double rate = speed[from[s]] / ratio[s] - speed[to[s]];
                twist[s] += dt * rate;
                torque[s] = stiffness[s] * twist[s] + damping[s] * rate;
                sum[from[s]] -= torque[s] / ratio[s];
                sum[to[s]] += torque[s];
            }
            for (int k = 0; k < 2; k++) {
                air_gap[k] += dt / LAG * ((acts < 0 ? 0.0 : sent[acts][k]) - air_gap[k]);
                flange[k] += dt / 0.0005 * (torque[FLANGE_L + k] - flange[k]);
            }
            for (int j = 0; j < INERTIAS; j++)
                speed[j] += dt / J[j] * (sum[j] - drag[j] * speed[j]);
        }
    }
    return 0;
}
