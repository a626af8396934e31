// A fixed-step Runge-Kutta method of order eight, for errors of 1e-8 and below, where it is several times cheaper than
// order four: twelve stages of Dormand and Prince with the weights of order eight of DOP853. Hairer, Nørsett & Wanner,
// Solving Ordinary Differential Equations I, 2nd ed., 1993, sec. II.5 and II.10, and the code they publish with it.
#pragma once

#include <array>
#include <utility>

#include "long_step.hpp"

namespace saltus {

// A method for `advance` and what stands on it, in place of the default Rk4: `advance<Rk8>(m, p, u, h)`.
struct Rk8 {
  static constexpr bool long_steps = true;  // the cubic through the ends only tells where to look
  static constexpr int stages = 12;

  // Row i makes stage i + 2 of the rates of those before it, the last row the end of the step. A row begins with its
  // node c_i and goes on with a_ij, j > 1: it is used as c_i f0 + sum_j a_ij (k_j - f0), which has a_i1 = c_i - sum_j
  // a_ij. So a constant rate is integrated exactly, and the large numbers meet small ones.
  static constexpr std::array<std::array<double, stages>, stages> tableau{{
      {5.26001519587677318785587544488e-2},
      {7.89002279381515978178381316732e-2, 5.91751709536136983633785987549e-2},
      {1.18350341907227396726757197510e-1, 0, 8.87627564304205475450678981324e-2},
      {2.81649658092772603273242802490e-1, 0, -8.84549479328286085344864962717e-1, 9.24834003261792003115737966543e-1},
      {1.0 / 3.0, 0, 0, 1.70828608729473871279604482173e-1, 1.25467687566822425016691814123e-1},
      {0.25, 0, 0, 1.70252211019544039314978060272e-1, 6.02165389804559606850219397283e-2, -1.7578125e-2},
      {4.0 / 13.0, 0, 0, 1.70383925712239993810214054705e-1, 1.07262030446373284651809199168e-1,
       -1.53194377486244017527936158236e-2, 8.27378916381402288758473766002e-3},
      {6.51282051282051282051282051282e-1, 0, 0, -3.36089262944694129406857109825, -8.68219346841726006818189891453e-1,
       2.75920996994467083049415600797e1, 2.01540675504778934086186788979e1, -4.34898841810699588477366255144e1},
      {0.6, 0, 0, -2.48811461997166764192642586468, -5.90290826836842996371446475743e-1,
       2.12300514481811942347288949897e1, 1.52792336328824235832596922938e1, -3.32882109689848629194453265587e1,
       -2.03312017085086261358222928593e-2},
      {6.0 / 7.0, 0, 0, 5.18637242884406370830023853209, 1.09143734899672957818500254654,
       -8.14978701074692612513997267357, -1.85200656599969598641566180701e1, 2.27394870993505042818970056734e1,
       2.49360555267965238987089396762, -3.0467644718982195003823669022},
      {1, 0, 0, -1.05344954667372501984066689879e1, -2.00087205822486249909675718444,
       -1.79589318631187989172765950534e1, 2.79488845294199600508499808837e1, -2.85899827713502369474065508674,
       -8.87285693353062954433549289258, 1.23605671757943030647266201528e1, 6.43392746015763530355970484046e-1},
      {1, 0, 0, 0, 0, 4.45031289275240888144113950566, 1.89151789931450038304281599044, -5.8012039600105847814672114227,
       3.1116436695781989440891606237e-1, -1.52160949662516078556178806805e-1, 2.01365400804030348374776537501e-1,
       4.47106157277725905176885569043e-2},
  }};

  // State after a step of length h [s] from x, where f0 = f(x) is already known: eleven evaluations of f. Sets f1, the
  // rate at the end but for O(h^5): that of the last stage.
  template <int N, class S, class F, class H>
  static Vec<N, S> step(const F& f, const Vec<N, S>& x, const Vec<N, S>& f0, const H& h, Vec<N, S>& f1) noexcept {
    std::array<Vec<N, S>, stages> d;  // k_j - f0, the first place being f0's own
    d[0] = f0;
    const auto fill = [&]<std::size_t... I>(std::index_sequence<I...>) {
      ((d[I + 1] = f(combined<I, N, S>(x, d, h)) - f0), ...);
    };
    fill(std::make_index_sequence<stages - 1>{});
    f1 = f0 + d[stages - 1];
    return combined<stages - 1, N, S>(x, d, h);
  }
  template <int N, class S, class F, class H>
  static Vec<N, S> step(const F& f, const Vec<N, S>& x, const Vec<N, S>& f0, const H& h) noexcept {
    Vec<N, S> f1;
    return step<N, S>(f, x, f0, h, f1);
  }

 private:
  // x + h sum_j tableau[Row][j] d_j; zeros cost nothing.
  template <std::size_t Row, int N, class S, class H>
  static Vec<N, S> combined(const Vec<N, S>& x, const std::array<Vec<N, S>, stages>& d, const H& h) noexcept {
    Vec<N, S> y;
#pragma GCC unroll 8
    for (int i = 0; i < N; ++i) {
      S sum = d[0][i] * tableau[Row][0];
      const auto gather = [&]<std::size_t... J>(std::index_sequence<J...>) {
        (add<tableau[Row][J + 1] != 0.0>(sum, d[J + 1][i], tableau[Row][J + 1]), ...);
      };
      gather(std::make_index_sequence<Row>{});
      y[i] = x[i] + sum * h;
    }
    return y;
  }
  template <bool Any, class S>
  static void add(S& sum, const S& d, double weight) noexcept {
    if constexpr (Any) sum += d * weight;
  }
};

}  // namespace saltus
