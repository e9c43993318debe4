// SPDX-License-Identifier: MIT
//
// A skate on an inclined plane in C++, as an object: the model's functions are static members that get the object back from
// user_data. One function gives all terms. The motion is a cycloid.
//
//     c++ skate.cpp $(pkg-config --cflags --libs tandem)
#include <tandem.h>

#include <array>
#include <cmath>
#include <cstdio>
#include <exception>
#include <memory>
#include <stdexcept>

class Skate {
public:
    static constexpr int n = 3; // x downhill, y, heading
    using Vector = std::array<double, n>;

    Skate(double slope, double inertia)
        : slope_(slope), inertia_(inertia), problem_(tandem_new(n, 0, 1, this), tandem_free)
    {
        check(tandem_set_evaluate(problem_.get(), evaluate,
                                  TANDEM_JACOBIAN | TANDEM_GAMMA | TANDEM_MASS | TANDEM_FORCE));
        check(tandem_set_row_name(problem_.get(), 0, "no slip"));
        check(tandem_set_text(problem_.get(), "stepper", "dopri5"));
        check(tandem_set_real(problem_.get(), "rtol", 1e-10));
    }
    Skate(const Skate &) = delete; // the problem knows the address of this object
    Skate &operator=(const Skate &) = delete;

    void start(double t, const Vector &q, const Vector &qd) { check(tandem_start(problem_.get(), t, q.data(), qd.data())); }

    Vector at(double t) // the coordinates at a time to come
    {
        Vector q;
        check(tandem_integrate(problem_.get(), t));
        check(tandem_get_state(problem_.get(), nullptr, q.data(), nullptr, nullptr));
        return q;
    }

private:
    static int evaluate(int need, double, const double *q, const double *qd, double *, double *jacobian, double *,
                        double *gamma, double *mass, double *force, void *user_data) noexcept
    {
        const auto &self = *static_cast<const Skate *>(user_data);
        const double s = std::sin(q[2]), c = std::cos(q[2]);
        if (need & TANDEM_JACOBIAN) {
            jacobian[0] = s;
            jacobian[1] = -c;
            jacobian[2] = 0;
        }
        if (need & TANDEM_GAMMA) gamma[0] = qd[2] * (c * qd[0] + s * qd[1]);
        if (need & TANDEM_MASS) {
            for (int i = 0; i < n * n; i++) mass[i] = 0;
            mass[0] = mass[4] = 1;
            mass[8] = self.inertia_;
        }
        if (need & TANDEM_FORCE) {
            force[0] = self.slope_;
            force[1] = force[2] = 0;
        }
        return 0;
    }

    void check(int status) const
    {
        if (status != TANDEM_OK) throw std::runtime_error(tandem_message(problem_.get()));
    }

    double slope_, inertia_;
    std::unique_ptr<tandem_problem, void (*)(tandem_problem *)> problem_;
};

int main()
try {
    const double slope = 9.81 * std::sin(0.3), spin = 1.5, a = slope / (4 * spin * spin);
    Skate skate(slope, 0.2);
    skate.start(0, {0, 0, 0}, {0, 0, spin});
    double error = 0;
    for (int i = 1; i <= 10; i++) {
        const double t = i, b = 2 * spin * t;
        const Skate::Vector q = skate.at(t), exact{a * (1 - std::cos(b)), a * (b - std::sin(b)), spin * t};
        for (int j = 0; j < Skate::n; j++) error = std::fmax(error, std::fabs(q[j] - exact[j]));
        std::printf("%6.1f %13.9f %13.9f %13.9f\n", t, q[0], q[1], q[2]);
    }
    std::printf("error: %.1e\n", error);
} catch (const std::exception &problem) {
    std::fprintf(stderr, "%s\n", problem.what());
    return 1;
}
