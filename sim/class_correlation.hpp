// Which errors go together. Noise that has gone through a periodic machine is the same noise on all lines q + l P of a
// class and on every output, so that the estimates of one line err together; lines of different classes, or of
// different experiments, do not.
#pragma once

#include <array>
#include <map>
#include <span>
#include <vector>

#include "core/spectrum/estimator.hpp"
#include "core/spectrum/noise.hpp"

namespace saltus {

// The estimator, which also keeps the covariance of each tone's class from one stimulus period to the next: streaming,
// in constant memory, no allocation.
template <int MaxTones, int MaxHarmonics, int Channels, int MaxSections, int MaxPeriod>
class ClassEstimator : public HtfEstimator<MaxTones, MaxHarmonics, Channels, MaxSections, MaxPeriod> {
  using Lines = HtfEstimator<MaxTones, MaxHarmonics, Channels, MaxSections, MaxPeriod>;
  static constexpr int orders = 2 * MaxHarmonics + 1;

 public:
  Status push(std::int64_t sample, const typename Lines::Sample& y) noexcept {
    const std::int64_t before = this->periods();
    const Status status = Lines::push(sample, y);
    if (this->periods() != before) take_period();
    return status;
  }
  Status push_missing() noexcept {
    const std::int64_t before = this->periods();
    const Status status = Lines::push_missing();
    if (this->periods() != before) take_period();
    return status;
  }

  // Unbiased E (Y_l - mean)(Y_l' - mean)* of one stimulus period at tone k, of channels c and c'; NaN before there are
  // two.
  Complex covariance(int k, int l, int c, int other_l, int other_c) const noexcept {
    return noise_[static_cast<std::size_t>(k)].covariance(row(l, c), row(other_l, other_c));
  }

 private:
  static constexpr int row(int l, int c) noexcept { return c * orders + l + MaxHarmonics; }

  void take_period() noexcept {
    for (int k = 0; k < this->tones(); ++k) {
      auto& noise = noise_[static_cast<std::size_t>(k)];
      if (this->periods() == 1) noise = {};
      std::array<Complex, Channels * orders> y{};
      for (int c = 0; c < Channels; ++c) {
        for (int l = -this->harmonics(); l <= this->harmonics(); ++l) {
          y[static_cast<std::size_t>(row(l, c))] = this->line(k, l, c);
        }
      }
      (void)noise.add(y);
    }
  }

  std::array<ClassNoise<Channels * orders>, MaxTones> noise_{};
};

// How the estimates H_m of one line err together, over harmonics and outputs.
struct ClassCorrelation {
  int line = 0;
  int harmonics = 0;
  double freedom = 0.0;     // complex degrees of freedom that it rests on, its neighbours' included
  double own = 0.0;         // without them
  Eigen::MatrixXcd matrix;  // E e e*, errors in units of their sigma: Hermitian, of unit diagonal

  // L, L L* = the matrix, where few degrees of freedom leave directions without noise but for a millionth.
  Eigen::MatrixXcd root() const;
  Eigen::Index row(int m, int output) const { return (2 * harmonics + 1) * output + m + harmonics; }
};

// The scatter of lines from one stimulus period to the next, collected class by class.
class ClassScatter {
 public:
  // Of one line in one experiment: the covariance of one period, known to `freedom` complex degrees of freedom; rows as
  // ClassCorrelation has them. Left out where the line has another number of rows already.
  void add(int line, int harmonics, const Eigen::MatrixXcd& covariance, double freedom);
  // The same from the periods themselves, each a vector of rows.
  void add(int line, int harmonics, std::span<const Eigen::VectorXcd> periods);
  void append(const ClassScatter& more);
  bool empty() const { return lines_.empty(); }

  // At a line, pooled with its neighbours until there are 12 degrees of freedom; freedom 0 where none is known.
  ClassCorrelation correlation(int line) const;

 private:
  struct Sum {
    int harmonics = 0;
    double freedom = 0.0;
    Eigen::MatrixXcd scatter;
  };
  std::map<int, Sum> lines_;
};

}  // namespace saltus
