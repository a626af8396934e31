// Closing the loop: what does the model lack? Given a record and a declared machine, finds the residual, traces it to
// an effect, adds it, and reports the error before and after. Inventing a cause is worse than finding none.
#pragma once

#include <cstdint>
#include <functional>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "evidence.hpp"
#include "fit.hpp"
#include "forecast.hpp"

namespace saltus::diagnosis {

inline constexpr double no_telling = 6.0;  // [-] of BIC, between two sets of effects

// [-] standard errors: from here the shape of the mean cycle alone tells one force from others.
inline constexpr double shaped = 15.0;

enum class Verdict { effect_found, no_discrepancy, parameters_only, ambiguous, unexplained };
std::string name(Verdict v);

struct Options {
  std::vector<std::pair<std::string, double>> tolerance;  // absolute, by parameter; 2 % of the value where not named
  std::vector<std::pair<std::string, double>> set;        // declared values
  std::vector<std::string> candidates;                    // empty: all; an entry ending in * is a beginning
  int holdout = -1;                                       // experiments held out; -1: a third of them
  double holdout_share = -1.0;                            // [-] of a record that no clock paces; -1: a third
  double stretch = 0.0;  // [s] of the stretches that one is cut into; 0: chosen by the record
  double horizon = 0.0;  // [s] of its free runs; 0: chosen by the record
  std::uint64_t seed = 1;
  double false_alarm = 0.01;  // [-] probability of any candidate passing when there is nothing
  std::function<void(double, const char*)> progress;
};

// Whether a name is among those asked for: itself, by a beginning that ends in *, or by its law without the port.
bool wanted(const std::vector<std::string>& patterns, const std::string& name);

// Gives a machine the values that are declared.
void declare(Machine& machine, const Options& options);

struct Finding {
  std::string name, unit;
  double value = 0.0, low = 0.0, high = 0.0;                // estimate and 95 % interval
  double declared = 0.0;                                    // of an effect nobody declared 0
  double z = 0.0;                                           // from there, in standard errors
  double phase = std::numeric_limits<double>::quiet_NaN();  // [turn] where a force that repeats with it is largest
  std::vector<std::string> ties;
};

struct ParameterRow {
  std::string name, unit;
  double declared = 0.0, tolerance = 0.0, refitted = 0.0, refitted_error = 0.0, with_effect = 0.0,
         with_effect_error = 0.0;
};

// Normalised errors E = sqrt(chi^2 / n) over single measurements: 1 is the noise.
struct Errors {
  double before = 0.0, refit = 0.0, after = 0.0, floor = 0.0;
};
struct OutputError {
  std::string name, unit;
  double before = 0.0, refit = 0.0, after = 0.0, noise = 0.0;  // [unit] root mean square
};

struct CandidateRow {
  std::string name, unit;
  double z = 0.0;             // score at the refitted baseline
  double value = 0.0;         // estimate: of the nonlinear fit where there was one, else first order
  double bic = 0.0;           // relative to the baseline, negative is better; NaN where not fitted
  double heldout = 0.0;       // normalised error on held-out data; NaN where not fitted
  double kept = 0.0;          // share of the signature the nuisance does not imitate
  double limit = 0.0;         // detection limit, 95 % power
  std::vector<Seen> clarity;  // of what changes the charts, by rising size; of others a straight line
  std::string remark;
};

struct Rival {
  std::vector<std::string> names;
  double bic = 0.0;                                             // against the best; no clock: may be below, where
  double predicted = std::numeric_limits<double>::quiet_NaN();  // [-] this is above 1: error of predicting parts left
                                                                // out of the fit, over that of the best
};

struct Twin {
  std::string first, second;
  double cosine = 0.0;
};

// A force over the turn of the clock at one port, from the refitted baseline's residual.
struct Profile {
  std::string port, unit;
  std::vector<std::string> knots;           // coefficients, one a phase
  std::vector<double> phase, force, error;  // [turn], [unit]
  std::vector<double> limit;                // [unit] what would be seen at each phase, by itself; not a number: none
  double explained = 0.0;                   // fall of chi^2
};

struct Where {
  std::string chart, port;
  double from = 0.0, to = 0.0;  // [turn]
  bool known = false;
};

// One line of the frequency response: measured, and of the model by the same arithmetic.
struct Response1 {
  int m = 0;       // harmonic
  double f = 0.0;  // [cycle per cycle] of the input
  std::size_t output = 0;
  double measured[2]{}, refit[2]{}, after[2]{};  // real, imaginary
  double sigma = 0.0;
};

struct MeanCycle {  // (sections), of one output, in noise units of the mean
  std::vector<double> before, refit, after;
};

// How an effect earned its place where the model is never quite true.
struct Step {
  std::string effect;
  std::vector<std::string> beside;  // the effects it joined
  double gain = 0.0;                // [-] of the likelihood
  double predicted = 0.0;           // [-] error left of that before, on parts left out of the fit
  int better = 0, parts = 0;        // parts predicted better
  bool taken = false;
  std::string instead;    // of this effect, which is as likely: empty where that decided
  double free_run = 1.0;  // [-] error of free runs over the fitted part, over what it is with that one
};

// What a record that no clock paces has beside.
struct SelfPaced {
  bool is = false;
  double stretch = 0.0, spacing = 0.0, jitter = 0.0;  // [s], [s], [-]
  int stretches = 0, still = 0, fitted = 0;           // all; left out because nothing moved; fitted
  double independent = 0.0;                           // [-] independent numbers in the residual
  std::vector<FreeRun> runs;
  std::vector<Trace> traces;  // of the held-out free runs
  std::vector<Step> steps;
  std::vector<bool> explained;  // (outputs) the effects made its free runs clearly better
  bool doubt = false;           // a rival, or an effect not claimed: longer stretches may tell more
};

struct Diagnosis {
  Verdict verdict = Verdict::unexplained;
  std::string record, model;
  std::vector<Finding> effects;
  std::vector<ParameterRow> parameters;
  Errors all, heldout;
  double excess_explained = 0.0;           // of the held-out excess over the noise, from refit to after; -1 at least
  double excess_explained_declared = 0.0;  // the same from the declared model
  double chi2_refit = 0.0, chi2_after = 0.0, expected = 0.0;  // of the means over repeats
  std::vector<OutputError> outputs;
  std::vector<CandidateRow> candidates;
  std::vector<Rival> rivals;
  std::vector<Twin> twins;
  std::vector<View> views_declared, views_refit, views_after;
  Where where;
  std::vector<Profile> profiles;
  std::vector<std::pair<std::string, double>> descriptive;  // law, coefficient
  std::vector<MeanCycle> mean_cycle;                        // (outputs)
  std::vector<Response1> responses;
  std::vector<std::string> charts;  // of the orbit, section by section
  std::vector<std::string> notes, story;
  std::string separate;    // the experiment that would tell the ties apart
  double threshold = 0.0;  // of |z|
  int tried = 0;           // candidates
  int repeats = 1, experiments = 0, sections = 0;
  bool noise_measured = false;
  bool wandering = false;     // repeats of one stimulus differ by what moves the machine
  std::vector<int> held_out;  // experiments
  Quality quality;
  std::vector<double> noise;
  std::vector<std::string> output_names, output_units;
  std::vector<std::pair<std::string, double>> seconds;  // where the time went
  SelfPaced self_paced;
};

// Throws RecordError for a record that cannot be compared with the machine.
Diagnosis diagnose(const Record& record, Machine& machine, const Options& options);

// The same for a record that no clock paces; diagnose() comes here by itself.
Diagnosis diagnose_self_paced(const Record& record, Machine& machine, const Options& options);

// Refuses what is plainly not a record of this machine: units off by powers of ten, swapped columns, a shifted clock.
void refuse_nonsense(const Problem& p, const Data& data, const std::string& record);

}  // namespace saltus::diagnosis
