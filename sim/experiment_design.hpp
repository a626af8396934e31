// Plans made for a purpose: a low peak, fewer tones at a time, or lines left silent on which distortion shows.
#pragma once

#include "plan.hpp"

namespace saltus {

struct DesignOptions {
  int tones = 0;         // at most so many in an experiment; 0: as many as the rules allow
  bool odd = false;      // odd lines only, with an even period: even-order distortion falls on the silent even lines
  int detection = 0;     // [class] odd residue classes left silent in each experiment: odd-order distortion shows there
  bool crest = false;    // phases sought for a low peak instead of drawn at random
  int realisations = 1;  // times that the plan is played, with other phases each time
  double peak_limit = 0.0;  // [input unit] largest input between samples too; amplitudes are scaled down to it; 0: none

  bool plain() const {
    return tones == 0 && !odd && detection == 0 && !crest && realisations == 1 && peak_limit == 0.0;
  }
};

// make_plan() with these options; every experiment obeys the rules of lines.hpp. Throws std::invalid_argument, naming
// the option and the mend.
Plan design_plan(const PlanOptions& options, const DesignOptions& design);

// Peak over root mean square of a stimulus [-], its peak sought between the samples too.
double crest_between_samples(const Multisine<max_tones>& stimulus);

}  // namespace saltus
