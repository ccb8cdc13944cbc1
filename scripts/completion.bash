# Completion of scripts/run (installed: undine) in bash:   source scripts/completion.bash
# Offers cases, the options that the script has, and after --set every key of docs/case-file.md.
_undine_run()
{
  local here word before
  here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
  word=${COMP_WORDS[COMP_CWORD]}
  before=${COMP_WORDS[COMP_CWORD - 1]}
  COMPREPLY=()
  case $before in
    --set)
      local keys page
      for page in "$here/../docs/case-file.md" "$here/../../doc/undine/case-file.md"; do
        [ -f "$page" ] || continue
        keys=$(awk '/^## `\[/ { t = $0; many = t ~ /\[\[/; gsub(/[^a-z_.]/, "", t); if (many) sub(/[a-z_]+$/, "&.0", t) }
                    /^\| `/ { k = $2; gsub(/`/, "", k); print t "." k "=" }' "$page")
        break
      done
      mapfile -t COMPREPLY < <(compgen -W "$keys" -- "$word")
      compopt -o nospace 2>/dev/null
      ;;
    --out) mapfile -t COMPREPLY < <(compgen -d -- "$word") ;;
    --ranks) mapfile -t COMPREPLY < <(compgen -W "fluid= solid= coupler=" -- "$word") ;;
    --until) ;;
    *)
      if [[ $word == -* ]]; then
        local options
        options=$(grep -o 'add_argument("--[a-z-]*"' "$here/run_case.py" | grep -v build | sed 's/.*"\(--[a-z-]*\)"/\1/')
        mapfile -t COMPREPLY < <(compgen -W "$options --help" -- "$word")
      else
        local case
        for case in "$here"/../cases/*/case.toml cases/*/case.toml; do
          [ -f "$case" ] && case=$(dirname "$case") && COMPREPLY+=($(compgen -W "cases/$(basename "$case")" -- "$word"))
        done
        mapfile -t COMPREPLY < <(printf '%s\n' "${COMPREPLY[@]}" | sort -u; compgen -f -X '!*.toml' -- "$word")
      fi
      ;;
  esac
}
complete -o default -F _undine_run scripts/run ./scripts/run undine
