/* SPDX-License-Identifier: MIT
 *
 * A ball on a rod that swings in a plane from 60 degrees, in C: q = (x, y), (q'q - l^2)/2 = 0. After ten periods and a
 * quarter it passes the lowest point, with the speed that the energy gives.
 *
 *     cc pendulum.c $(pkg-config --cflags --libs tandem) -lm
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <tandem.h>

enum { N = 2 };

struct parameters {
    double mass, length, gravity;
};

/* Phi */
static int rod(double t, const double *q, double *value, void *user_data)
{
    const struct parameters *p = user_data;
    (void)t;
    value[0] = (q[0] * q[0] + q[1] * q[1] - p->length * p->length) / 2;
    return 0;
}

/* Phi_q, one row */
static int rod_jacobian(double t, const double *q, double *value, void *user_data)
{
    (void)t, (void)user_data;
    value[0] = q[0];
    value[1] = q[1];
    return 0;
}

/* gamma of Phi_q qdd = -gamma */
static int rod_acceleration(double t, const double *q, const double *qd, double *value, void *user_data)
{
    (void)t, (void)q, (void)user_data;
    value[0] = qd[0] * qd[0] + qd[1] * qd[1];
    return 0;
}

/* M by rows */
static int mass(double t, const double *q, double *value, void *user_data)
{
    const struct parameters *p = user_data;
    (void)t, (void)q;
    value[0] = value[3] = p->mass;
    value[1] = value[2] = 0;
    return 0;
}

/* Q_A */
static int weight(double t, const double *q, const double *qd, double *value, void *user_data)
{
    const struct parameters *p = user_data;
    (void)t, (void)q, (void)qd;
    value[0] = 0;
    value[1] = -p->mass * p->gravity;
    return 0;
}

static void check(int status, tandem_problem *problem)
{
    if (status == TANDEM_OK) return;
    fprintf(stderr, "%s\n", tandem_message(problem));
    tandem_free(problem);
    exit(EXIT_FAILURE);
}

int main(void)
{
    const double pi = acos(-1.0), angle = pi / 3;
    struct parameters p = {.mass = 1.5, .length = 2.0, .gravity = 9.81};
    double q[N] = {p.length * sin(angle), -p.length * cos(angle)}, qd[N] = {0, 0}, lambda, steps;

    /* The period is 2 pi sqrt(l/g) / agm(1, cos(angle/2)). */
    double a = 1, b = cos(angle / 2);
    for (int i = 0; i < 6; i++) {
        double mean = (a + b) / 2;
        b = sqrt(a * b);
        a = mean;
    }
    double t = 10.25 * 2 * pi * sqrt(p.length / p.gravity) / a;

    if (tandem_interface_version() / 1000 != TANDEM_INTERFACE_VERSION / 1000) return EXIT_FAILURE;
    tandem_problem *problem = tandem_new(N, 1, 0, &p);
    check(tandem_set_position_function(problem, "holonomic", rod), problem);
    check(tandem_set_position_function(problem, "holonomic_jacobian", rod_jacobian), problem);
    check(tandem_set_motion_function(problem, "constraint_acceleration", rod_acceleration), problem);
    check(tandem_set_position_function(problem, "mass_matrix", mass), problem);
    check(tandem_set_motion_function(problem, "applied_force", weight), problem);
    check(tandem_set_text(problem, "stepper", "sdirk54"), problem);
    check(tandem_set_real(problem, "step", 1e-3), problem);
    check(tandem_check(problem, 0, q, qd), problem); /* names a wrong sign or entry, which the run may not notice */
    check(tandem_start(problem, 0, q, qd), problem);
    check(tandem_integrate(problem, t), problem);
    check(tandem_get_state(problem, &t, q, qd, NULL), problem);
    check(tandem_get_multipliers(problem, t, &lambda), problem);
    check(tandem_get_statistic(problem, "steps", &steps), problem);
    tandem_free(problem);

    double speed = sqrt(2 * p.gravity * p.length * (1 - cos(angle)));
    double tension = p.mass * (p.gravity + speed * speed / p.length);
    double error = fabs(q[0]);
    error = fmax(error, fabs(q[1] + p.length));
    error = fmax(error, fabs(qd[0] + speed));
    error = fmax(error, fabs(qd[1]));
    error = fmax(error, fabs(lambda * p.length - tension)); /* C' lambda is the force of the rod on the ball, reversed */
    printf("t = %.6f after %.0f steps: x, y = %.9f %.9f, tension %.6f N\n", t, steps, q[0], q[1], lambda * p.length);
    printf("error: %.1e\n", error);
    return EXIT_SUCCESS;
}
