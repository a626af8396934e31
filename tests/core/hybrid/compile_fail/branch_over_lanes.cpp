// expect: Mask<4>
// expect: bool
#include "core/flow/lanes.hpp"

namespace small {

using namespace saltus;

struct Line : Chart<1> {};

// Says that it does not branch, and does.
template <class S = double>
struct Model {
  using Charts = List<Line>;
  using Edges = List<>;
  static constexpr std::string_view name = "small";
  static constexpr bool branchless = true;
  static constexpr std::array<Quantity, 0> inputs{};
  static constexpr std::array outputs{Quantity{"x", "-"}};
  S k = 1.0;
  static constexpr auto parameters() { return std::array{Parameter{"k", "-", &Model::k}}; }
  Vec<1, S> flow(Line, const Vec<1, S>& x, const Vec<0, S>&) const noexcept {
    if (x[0] < 0.0) return Vec<1, S>(k);
    return Vec<1, S>(-k);
  }
  Vec<1, S> output(Line, const Vec<1, S>& x, const Vec<0, S>&) const noexcept { return x; }
  Start<Line, S> start() const noexcept { return {Vec<1, S>(S(0.0))}; }
};

void run(LaneRuns<Model<>, 4>& runs, const Vec<0, Lanes<4>>& u) { runs.step(u, Timebase{}); }

}  // namespace small
