// Habits of the page's modules. What is undefined or of the wrong type tsc finds.
import js from "@eslint/js";

export default [
  { ignores: ["page/uplot"] },
  js.configs.recommended,
  {
    linterOptions: { reportUnusedDisableDirectives: "error" },
    rules: {
      "no-undef": "off",
      "no-unused-vars": ["error", { args: "after-used", argsIgnorePattern: "^_" }],
      "consistent-return": "off",
      eqeqeq: "error",
      "no-eval": "error",
      "no-implied-eval": "error",
      "max-len": ["error", { code: 99, ignoreUrls: true, ignoreStrings: true, ignoreTemplateLiterals: true }],
      "no-var": "error",
      "prefer-const": "error",
      "no-restricted-properties": ["error", ...["innerHTML", "outerHTML", "insertAdjacentHTML"].map((property) => ({ property, message: "Texts of others must stay texts." }))],
    },
  },
];
