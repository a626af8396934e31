// Where in the stride the force is missing, what the residual looks like, and what would tell ties apart.
#pragma once

#include "diagnosis.hpp"
#include "search.hpp"

namespace saltus::diagnosis {

// The force at each port over the turn of the clock that the residual of a fit asks for; fills where and profiles.
// `limit_z`: by how many standard errors a force that is seen is off.
void locate(Diagnosis& d, const Problem& p, const std::vector<int>& segments, const Fit& refit, double limit_z);

// Mean-cycle residuals and frequency responses.
void draw(Diagnosis& d, const Problem& p, const std::vector<int>& segments, const Fit& declared, const Fit& refit,
          const Fit& after);

// The stimulus that would tell the chosen effects from their closest rival, in words.
std::string separating_experiment(const Diagnosis& d, const Problem& p, const std::vector<int>& segments,
                                  const Search& search, const Trial& chosen);

}  // namespace saltus::diagnosis
